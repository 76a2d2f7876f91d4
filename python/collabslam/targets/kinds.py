"""What is printed: AprilTags and ArUco tags, and checkerboards, with their sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam.errors import InputError
from collabslam.types import Array

FAMILIES = {
    "16h5": "DICT_APRILTAG_16h5",
    "25h9": "DICT_APRILTAG_25h9",
    "36h10": "DICT_APRILTAG_36h10",
    "36h11": "DICT_APRILTAG_36h11",
    "aruco": "DICT_ARUCO_ORIGINAL",
    "mip_36h12": "DICT_ARUCO_MIP_36h12",
    **{f"{n}x{n}_{k}": f"DICT_{n}X{n}_{k}" for n in (4, 5, 6, 7) for k in (50, 100, 250, 1000)},
}
"""Sets of tags that OpenCV reads, by our name: AprilTag's and ArUco's."""

_LONGEST = 100.0  # metres of a printed target


@dataclass(frozen=True)
class Tag:
    """A printed AprilTag or ArUco tag.

    Attributes
    ----------
    family : str
        Its set, one of `FAMILIES`, as ``36h11``.
    number : int
        Which of the set.
    side : float
        Side of its black square, metres.

    Raises
    ------
    InputError
        If there is no such set, or the numbers are impossible.
    """

    family: str
    number: int
    side: float

    def __post_init__(self) -> None:
        if self.family not in FAMILIES:
            raise InputError(f"There is no set of tags '{self.family}'; use one of {', '.join(FAMILIES)}.")
        if isinstance(self.number, bool) or not isinstance(self.number, int) or self.number < 0:
            raise InputError(f"The tag's number is {self.number!r}; give a whole number from 0 on.")
        object.__setattr__(self, "side", _length(self.side, "side of the tag"))

    def __str__(self) -> str:
        return f"{self.family}:{self.number}={self.side!r}"

    @classmethod
    def parse(cls, text: str) -> Tag:
        """``36h11:3=0.16``: set, number, side in metres; raises InputError."""
        family, _, rest = text.partition(":")
        number, _, side = rest.partition("=")
        try:
            return cls(family, int(number), float(side))
        except InputError:
            raise
        except ValueError:
            raise InputError(
                f"'{text}' is not a tag; give its set, number and side in metres, as 36h11:3=0.16."
            ) from None

    def corners(self) -> Array:
        """(4, 3) its corners: x right, y down, z into the paper, from its middle; metres."""
        half = self.side / 2.0
        return np.array([[-half, -half, 0.0], [half, -half, 0.0], [half, half, 0.0], [-half, half, 0.0]])


@dataclass(frozen=True)
class Board:
    """A printed checkerboard.

    Attributes
    ----------
    columns, rows : int
        Inner corners along and across, 3 or more.
    square : float
        Side of a square, metres.

    Raises
    ------
    InputError
        If it is not such a board.
    """

    columns: int
    rows: int
    square: float

    def __post_init__(self) -> None:
        whole = isinstance(self.columns, int | np.integer) and isinstance(self.rows, int | np.integer)
        if not whole or not 3 <= min(self.columns, self.rows) <= max(self.columns, self.rows) <= 100:
            raise InputError(
                f"A board of {self.columns} x {self.rows} inner corners does not do; take 3 x 4 to 100 x 100."
            )
        object.__setattr__(self, "square", _length(self.square, "side of the board's squares"))

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}:{self.square!r}"

    @classmethod
    def parse(cls, text: str) -> Board:
        """``7x5:0.03``: inner corners along and across, side of a square in metres; raises InputError."""
        counts, _, square = text.partition(":")
        columns, _, rows = counts.partition("x")
        try:
            return cls(int(columns), int(rows), float(square))
        except InputError:
            raise
        except ValueError:
            raise InputError(
                f"'{text}' is not a board; give its inner corners and the side of a square in metres, as "
                "7x5:0.03."
            ) from None

    @property
    def has_direction(self) -> bool:
        """Whether it looks different upside down: one number is odd and one even."""
        return (self.columns + self.rows) % 2 == 1

    def check_direction(self) -> None:
        """Raises InputError if two cameras may differ about where it begins."""
        if not self.has_direction:
            raise InputError(
                f"A board of {self.columns} x {self.rows} inner corners looks the same upside down, and two "
                "cameras may differ about it; take one with an odd and an even number."
            )

    def corners(self) -> Array:
        """(N, 3) its inner corners, row by row: x along, y across, from the first one; metres."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return np.asarray(
            self.square * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), np.float64
        )


def _length(value: float, name: str) -> float:
    """A length, metres; raises InputError if it is none."""
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float | np.number)
        or not 0.0 < value <= _LONGEST
    ):
        raise InputError(f"The {name} is {value!r}; give metres, up to {_LONGEST:g}.")
    return float(value)

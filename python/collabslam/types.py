"""The values that pass between recordings, the engine and the results.

Frames: W world, C robot camera Cs, F worn camera Cf (METHOD section 1).  ``t_ab`` maps points of B into A.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from collabslam._core import Camera
from collabslam.errors import InputError

Image = NDArray[np.uint8]
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ids = NDArray[np.int64]
Indices = NDArray[np.int64]


class Status(str, enum.Enum):
    """What the filter can say of its own pose."""

    OK = "OK"
    COASTING = "COASTING"
    LOST = "LOST"


@dataclass(frozen=True)
class WornView:
    """One view of the worn camera Cf.

    Attributes
    ----------
    image : (H, W) uint8
    t_cf : (4, 4) float64
        Measured pose of Cf relative to Cs when the view was taken: maps points of F into C, metres.
    covariance : (6, 6) float64
        Of ``t_cf`` over (translation, rotation), tangent on the right, m^2 and rad^2.
    bias : (6, 6) float64 or None
        The part of ``covariance`` that lasts from frame to frame (METHOD section 6), with the time constant
        ``worn.bias_time``; None if that is not known: then it is the share ``worn.bias_share``.
    t : float or None
        When it was taken, seconds, by the clock of Cs's time stamps: between two frames, or up to
        ``worn.late`` before the one that it comes with (METHOD section 21); None if at the frame's instant.
    """

    image: Image
    t_cf: Array
    covariance: Array
    bias: Array | None = None
    t: float | None = None


@dataclass(frozen=True)
class Frame:
    """One frame of a recording.

    Attributes
    ----------
    index : int
        Position in the recording, from 0.
    t : float
        Time stamp, seconds.
    image : (H, W) uint8
        Grey image of Cs.
    worn : WornView or None
        The worn camera's view, where there is one.
    """

    index: int
    t: float
    image: Image
    worn: WornView | None = None


@dataclass(frozen=True)
class Target:
    """A known metric target in the first frame (METHOD section 10).

    Attributes
    ----------
    points : (N, 3) float64
        Points in the target's frame, metres.
    patches : sequence of (h, w) uint8
        One patch of each point, as the camera sees it from the start pose.
    t_tc : (4, 4) float64
        Approximate start pose: maps points of C into the target's frame.
    covariance : (6, 6) float64
        Of ``t_tc`` over (translation, rotation), tangent on the right, m^2 and rad^2.
    """

    points: Array
    patches: Sequence[Image]
    t_tc: Array
    covariance: Array


@dataclass(frozen=True)
class Board:
    """A checkerboard.

    Attributes
    ----------
    columns, rows : int
        Inner corners along and across; one odd and one even, so that both cameras agree where it begins.
    square : float
        Side of a square, metres.

    Raises
    ------
    InputError
        If it is no such board.
    """

    columns: int
    rows: int
    square: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or (self.columns + self.rows) % 2 == 0:
            raise InputError(
                f"A board of {self.columns} x {self.rows} inner corners does not do; take 3 x 4 or more, one "
                "number odd and one even."
            )
        if not (np.isfinite(self.square) and self.square > 0.0):
            raise InputError(f"The board's squares are {self.square}; give their side in metres.")


class Recording(Protocol):
    """What every data set is to the rest of the package.

    Attributes
    ----------
    name : str
        Short name, used in results.
    source : str
        Where the recording was read from.
    camera : Camera
        Calibration of Cs.
    worn_camera : Camera or None
        Calibration of Cf.
    times : (N,) float64
        Time stamps, seconds, strictly increasing if `open_recording` has opened it; a run leaves out those
        that are not.
    truth : (N, 4, 4) float64 or None
        True ``T_WC`` of Cs in the data set's own world; NaN where it is missing.  Never used by the filter.
    target : Target or None
    """

    @property
    def name(self) -> str: ...
    @property
    def source(self) -> str: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def worn_camera(self) -> Camera | None: ...
    @property
    def times(self) -> Array: ...
    @property
    def truth(self) -> Array | None: ...
    @property
    def target(self) -> Target | None: ...

    def __len__(self) -> int: ...

    def frame(self, i: int) -> Frame:
        """Frame ``i``; raises DataError naming the file if it is missing, broken or of the wrong size."""
        ...

    def image(self, i: int) -> Image:
        """The (H, W) uint8 image of Cs in frame ``i``."""
        ...

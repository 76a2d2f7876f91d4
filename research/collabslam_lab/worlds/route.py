"""A way through a building of square cells: where it runs, how it bends, which cells it needs.

Plan axes: x along the way at the start, y to the left, metres; the way starts at the origin.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from collabslam.errors import InputError
from collabslam.types import Array

CELL = 2.6
"""Side of a cell, which is the width of every corridor, metres."""
BEHIND, BEYOND = 2, 3
"""Cells of corridor behind the start and beyond the end."""

_STEP = 0.01
_EASE = 0.3
_TOKEN = re.compile(r"S(\d+)|([LR])")

Cell = tuple[int, int]


@dataclass(frozen=True)
class Route:
    """A way made of straight cells and quarter turns.

    Attributes
    ----------
    text : str
        Such as ``"S3 L S2"``: three cells ahead, a quarter turn to the left, two cells ahead.

    Raises
    ------
    InputError
        If the text is not such a way.
    """

    text: str

    def __post_init__(self) -> None:
        tokens = self.text.split()
        if not tokens or not all(_TOKEN.fullmatch(t) for t in tokens):
            raise InputError(f"The way '{self.text}' cannot be read; write it like 'S3 L S2'.")

    @property
    def moves(self) -> str:
        """One letter a cell: S, L or R."""
        return "".join("S" * int(t[1:]) if t[0] == "S" else t for t in self.text.split())

    @property
    def length(self) -> float:
        """Length of the centre line, metres."""
        return sum(CELL if move == "S" else np.pi * CELL / 4.0 for move in self.moves)

    @property
    def cells(self) -> list[Cell]:
        """Cells that the way touches in order, those behind its start and beyond its end included.

        Cell (0, 0) is the first one: x from 0 to `CELL`, y from -`CELL` / 2 to `CELL` / 2.
        """
        at, ahead = np.array([0, 0]), np.array([1, 0])
        cells = [(-k, 0) for k in range(BEHIND, 0, -1)]
        for move in self.moves + "S" * BEYOND:
            cells.append((int(at[0]), int(at[1])))
            if move != "S":
                side = 1 if move == "L" else -1
                ahead = side * np.array([-ahead[1], ahead[0]])
            at = at + ahead
        return list(dict.fromkeys(cells))

    def bend(self, s: Array) -> Array:
        """Curvature at arc lengths `s`, 1 / m, positive to the left."""
        grid, bend, *_ = self._line
        return np.asarray(np.interp(s, grid, bend))

    def along(self, s: npt.ArrayLike, left: npt.ArrayLike = 0.0) -> tuple[Array, Array]:
        """Positions (..., 2), `left` metres to the left of the centre line, and headings (...), radians."""
        grid, _, x, y, heading = self._line
        at = np.asarray(s, float)
        h = np.interp(at, grid, heading)
        px = np.interp(at, grid, x) - np.asarray(left) * np.sin(h)
        py = np.interp(at, grid, y) + np.asarray(left) * np.cos(h)
        return np.stack([px, py], axis=-1), np.asarray(h)

    @cached_property
    def _line(self) -> tuple[Array, Array, Array, Array, Array]:
        """Arc length, curvature, x, y and heading of the centre line, every centimetre."""
        before, after = (BEHIND - 0.5) * CELL, (BEYOND - 0.5) * CELL
        grid = np.arange(-before, self.length + after, _STEP)
        bend, start = np.zeros_like(grid), 0.0
        for move in self.moves:
            stop = start + (CELL if move == "S" else np.pi * CELL / 4.0)
            if move != "S":
                bend[(grid >= start) & (grid < stop)] = (1 if move == "L" else -1) * 2.0 / CELL
            start = stop
        window = np.ones(round(_EASE / _STEP)) / round(_EASE / _STEP)
        for _ in range(2):  # nobody turns the wheel in no time
            bend = np.convolve(bend, window, mode="same")
        heading = np.cumsum(bend) * _STEP
        middle = heading - 0.5 * bend * _STEP
        x, y = np.cumsum(np.cos(middle)) * _STEP, np.cumsum(np.sin(middle)) * _STEP
        origin = np.array([np.interp(0.0, grid, x), np.interp(0.0, grid, y)])
        return grid, bend, x - origin[0], y - origin[1], heading

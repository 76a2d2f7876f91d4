"""A place seen by a planar laser: walls, furniture, and rays cast against them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from collabslam.errors import InputError
from collabslam.types import Array

Z_UP_FROM_Y_DOWN = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""Maps a world with a camera's axes (x right, y down, z ahead) into one with x ahead, y left, z up."""


@dataclass(frozen=True)
class FloorPlan:
    """What stands in the plane of the scanners, in a world M whose z axis is up.

    Attributes
    ----------
    segments : (N, 2, 2) array
        Walls and sides of furniture: both ends of each, (x, y) of M, metres.
    circles : (K, 3) array
        Pillars and legs of tables and chairs: x, y and radius, metres.

    Raises
    ------
    InputError
        If a shape is wrong or a number is not finite.
    """

    segments: Array
    circles: Array

    def __init__(self, segments: ArrayLike, circles: ArrayLike | None = None) -> None:
        s = np.asarray(segments, dtype=np.float64).reshape(-1, 2, 2) if np.size(segments) else _NO_SEGMENTS
        c = np.asarray(circles, dtype=np.float64) if circles is not None and np.size(circles) else _NO_CIRCLES
        if np.ndim(segments) not in (1, 3) or c.ndim != 2 or c.shape[1] != 3:
            raise InputError("A floor plan is segments (N, 2, 2) and circles (K, 3): x, y, radius in metres.")
        if not (np.isfinite(s).all() and np.isfinite(c).all() and (c[:, 2] > 0.0).all()):
            raise InputError("A floor plan holds finite numbers, and circles of positive radius.")
        object.__setattr__(self, "segments", s)
        object.__setattr__(self, "circles", c)

    def plus(self, *others: FloorPlan) -> FloorPlan:
        """This plan with others in it."""
        plans = (self, *others)
        return FloorPlan(
            np.concatenate([p.segments for p in plans]), np.concatenate([p.circles for p in plans])
        )

    def ranges(self, origin: Array, directions: Array, more: Array | None = None) -> Array:
        """Lengths of rays until they meet something, (K,) in units of ``directions``; inf for nothing.

        Parameters
        ----------
        origin : (2,) array
        directions : (K, 2) array
            Horizontal parts of the rays' directions.
        more : (L, 3) array, optional
            Circles that are there now, such as legs.
        """
        out = np.full(len(directions), np.inf)
        if len(self.segments):
            a = self.segments[:, 0] - origin
            side = self.segments[:, 1] - self.segments[:, 0]
            with np.errstate(divide="ignore", invalid="ignore"):
                cross = directions[:, :1] * side[:, 1] - directions[:, 1:] * side[:, 0]
                length = (a[:, 0] * side[:, 1] - a[:, 1] * side[:, 0]) / cross
                share = (a[:, 0] * directions[:, 1:] - a[:, 1] * directions[:, :1]) / cross
                hit = (length > 0.0) & (share >= 0.0) & (share <= 1.0)
            out = np.where(hit, length, np.inf).min(axis=1)
        circles = self.circles if more is None else np.concatenate([self.circles, more])
        if len(circles):
            c = circles[:, :2] - origin
            norm = (directions**2).sum(axis=1)[:, None]
            middle = directions @ c.T
            root = middle**2 - norm * ((c**2).sum(axis=1) - circles[:, 2] ** 2)
            with np.errstate(invalid="ignore"):
                length = (middle - np.sqrt(root)) / norm
            out = np.minimum(out, np.where((root > 0.0) & (length > 0.0), length, np.inf).min(axis=1))
        return out


_NO_SEGMENTS = np.empty((0, 2, 2))
_NO_CIRCLES = np.empty((0, 3))


def polyline(points: ArrayLike, *, closed: bool = False) -> Array:
    """Segments (N, 2, 2) from point to point."""
    p = np.asarray(points, dtype=np.float64)
    ends = np.concatenate([p, p[:1]]) if closed else p
    return np.stack([ends[:-1], ends[1:]], axis=1)


def box(x: float, y: float, width: float, depth: float, heading: float = 0.0) -> Array:
    """Segments (4, 2, 2) of a cupboard, its middle at (x, y), turned by ``heading`` radians."""
    c, s = np.cos(heading), np.sin(heading)
    corners = 0.5 * np.array([[-width, -depth], [width, -depth], [width, depth], [-width, depth]])
    return polyline(corners @ np.array([[c, s], [-s, c]]) + (x, y), closed=True)


def table(x: float, y: float, width: float, depth: float, heading: float = 0.0, leg: float = 0.025) -> Array:
    """Circles (4, 3) of the legs of a table or chair."""
    corners = box(x, y, width, depth, heading)[:, 0]
    return np.column_stack([corners, np.full(4, leg)])


def together(parts: Iterable[Array] | Sequence[Array], width: int) -> Array:
    """Parts one after the other; an empty array (0, ...) for none.  ``width`` 2 is segments, 3 circles."""
    found = list(parts)
    if found:
        return np.concatenate(found)
    return _NO_SEGMENTS if width == 2 else _NO_CIRCLES

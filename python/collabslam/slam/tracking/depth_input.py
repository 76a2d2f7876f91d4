"""Depth from any other sensor, such as a range finder or a depth camera, for the next frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from collabslam._core import DepthMeasurement, Filter, UpdateReport
from collabslam.errors import InputError
from collabslam.formats.schema import Check, array, items, refuse
from collabslam.slam.map_change import ImagePoints
from collabslam.slam.state import PersistentState
from collabslam.slam.tracking.tracks import TrackingResult
from collabslam.slam.view import View
from collabslam.types import Array, Ids, Indices, Mask

NEAR = 4.0
"""A depth holds for the points of the image within so many pixels."""

CORNERS = 10
"""Corners looked at for each point that is missing: few of them are near a depth."""


@dataclass(frozen=True)
class Depths:
    """Depths of one frame as the filter takes them: id -1 is a new point."""

    ids: Ids = field(default_factory=lambda: np.empty(0, np.int64))
    uv: Array = field(default_factory=lambda: np.empty((0, 2)))
    depth: Array = field(default_factory=lambda: np.empty(0))
    sigma: Array = field(default_factory=lambda: np.empty(0))

    @property
    def observation(self) -> DepthMeasurement | None:
        """The argument ``depths`` of :meth:`Filter.update`."""
        return DepthMeasurement(self.ids, self.uv, self.depth, self.sigma) if len(self.ids) else None

    def births(self, report: UpdateReport) -> ImagePoints:
        """Features born from new points."""
        return ImagePoints.born(report.depths.born, self.uv) if len(self.ids) else ImagePoints()


def _depths(value: Any, where: str) -> None:
    """What `DepthInput.add` keeps: pixels (N, 2), depths and standard deviations (N,)."""
    if not isinstance(value, tuple) or len(value) != 3:
        refuse(where, "depths at pixels")
    array("<f8", None, 2)(value[0], where)
    for numbers in value[1:]:
        array("<f8", len(value[0]))(numbers, where)
        if not (numbers > 0.0).all():
            refuse(where, "depths above zero")


class DepthInput(PersistentState):
    """Keeps the depths that are given, and finds the points of the image they belong to."""

    PERSISTENT: ClassVar[Mapping[str, Check]] = {"_given": items(_depths)}

    def __init__(self) -> None:
        self._given: list[tuple[Array, Array, Array]] = []

    def add(self, uv: ArrayLike, depth: ArrayLike, sigma: ArrayLike) -> None:
        """Keep depths for the next frame; see `Slam.add_depth`."""
        try:
            pixels = np.asarray(uv, dtype=np.float64)
            if pixels.size == 0:
                pixels = pixels.reshape(0, 2)
            z, sd = (np.broadcast_to(np.asarray(x, dtype=np.float64), len(pixels)) for x in (depth, sigma))
            if pixels.ndim != 2 or pixels.shape[1] != 2:
                raise ValueError(f"uv has the shape {pixels.shape}")
        except (TypeError, ValueError) as error:
            raise InputError(
                "uv must be (N, 2) pixels, depth and sigma (N,) numbers or one for all; correct their shapes."
            ) from error
        if not (np.isfinite(pixels).all() and np.isfinite([z, sd]).all() and np.all([z > 0.0, sd > 0.0])):
            raise InputError(
                "uv, depth and sigma must be finite, depth and sigma above zero; leave others out."
            )
        Filter.check_depths(z, sd)
        if len(pixels):
            self._given = [*self._given, (pixels.copy(), z.copy(), sd.copy())]

    def forget(self) -> None:
        """Drop what was given: the frame it was for cannot be used."""
        self._given = []

    def take(self, view: View, found: TrackingResult, used: Ids, missing: int) -> Depths:
        """The depths given since the last frame, at the points of this one.

        Parameters
        ----------
        view : View
        found : TrackingResult
            Features tracked into this frame; each takes the nearest depth.
        used : (M,) int64
            Features that have another measurement with depth.
        missing : int
            Most new points to start.
        """
        if not self._given:
            return Depths()
        uv, depth, sigma = (np.concatenate(column) for column in zip(*self._given, strict=True))
        known = ~np.isin(found.ids, used)
        ids, points = found.ids[known], found.uv[known]
        nearest, near = _nearest(points, uv)
        ids, points, nearest = ids[near], points[near], nearest[near]
        if missing > 0:
            taken = np.concatenate([found.uv, found.candidate_uv])
            fresh = view.corners.pick(taken, CORNERS * missing)
            rows, near = _nearest(fresh, uv)
            fresh, rows = fresh[near][:missing], rows[near][:missing]
            ids = np.concatenate([ids, np.full(len(fresh), -1)])
            points, nearest = np.concatenate([points, fresh]), np.concatenate([nearest, rows])
        return Depths(ids, points, depth[nearest], sigma[nearest])


def _nearest(points: Array, uv: Array) -> tuple[Indices, Mask]:
    """For each point the row of the nearest depth, and whether that is near enough."""
    if not len(points):
        return np.empty(0, np.int64), np.empty(0, np.bool_)
    distance = np.linalg.norm(points[:, None] - uv[None], axis=2)
    rows = np.argmin(distance, axis=1)
    return rows, distance[np.arange(len(points)), rows] <= NEAR

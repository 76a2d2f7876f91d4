"""The real filter core fed with simulated points: who is who is known, nothing is searched in images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collabslam._core import Camera, DepthMeasurement, Filter, UpdateReport, WornMeasurement
from collabslam.settings.table import Settings
from collabslam.types import Array
from collabslam_lab.paper_simulation.estimators import Estimator
from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings
from collabslam_lab.switches import with_switches

Bools = NDArray[np.bool_]
FilterSettings = dict[str, bool | int | float | str]


def common_settings(s: SimulationSettings, estimator: Estimator, focal: float) -> FilterSettings:
    """What the simulation and an estimator say of the filter, with a focal length in pixels."""
    sigma = focal * np.radians(s.bearing_sigma) * (s.inflation if estimator.inflated else 1.0)
    return {
        "estimator.consistency": "gauge" if estimator.gauge else "none",
        "birth.first_pose": estimator.first_pose,
        "birth.min_parallax": s.min_parallax,
        "pixel.sigma_cs": float(sigma),
        "process.acceleration_density": s.acceleration_density,
        "process.angular_acceleration_density": float(np.radians(s.angular_acceleration_density)),
        "process.start_velocity_sd": s.path / s.duration,
    }


SimulatedView = tuple[Array, Array, Array, Bools]
"""Measured ``T_CF`` (4, 4), its covariance (6, 6), pixels in Cf (N, 2), and which points Cf sees (N,)."""


@dataclass(frozen=True)
class SimulatedFrame:
    """What is measured of N points in one frame.

    Attributes
    ----------
    time : float
        Seconds.
    uv : (N, 2) array
        Pixels in Cs.
    visible : (N,) bool array
    views : sequence of SimulatedView
        Of the worn cameras, in their order.
    depths : tuple or None
        Depths along the optical axis (N,) and their standard deviations (N,), metres, of every visible point.
    """

    time: float
    uv: Array
    visible: Bools
    views: Sequence[SimulatedView] = ()
    depths: tuple[Array, Array] | None = None


class CoreRun:
    """A filter and which of its features and candidates is which point.

    Parameters
    ----------
    camera : Camera
        Of Cs and of Cf.
    settings : mapping
        Of the filter, switches among them, over its defaults. Nothing is rejected, and the reported
        covariance is that of noise as it is claimed; all rows are taken at once.
    in_view : int
        Features and candidates in view that are asked for.
    persons : int
        Worn cameras.
    """

    def __init__(self, camera: Camera, settings: FilterSettings, in_view: int, persons: int = 1) -> None:
        fixed: FilterSettings = {
            "validate.test": "none",
            "process.map_drift": 0.0,
            "calibration.readout": 0.0,
            "calibration.readout_sd": 0.0,
            "worn.readout": 0.0,
        }
        changes = {f"filter.{key}": value for key, value in {**fixed, **settings}.items()}
        own = with_switches(Settings.default(), changes)
        self.filter = Filter(
            camera,
            [camera] * persons,
            settings=own.filter,
        )
        self.features: dict[int, int] = {}
        self._waiting: dict[int, int] = {}
        self._in_view = in_view

    def start_from_points(self, time: float, points: Array, numbers: list[int], sigma: float) -> None:
        """Starts from points (M, 3) in C, metres, each known to ``sigma`` per axis."""
        self.filter.predict(time)
        count = len(points)
        noise = np.repeat(sigma**2 * np.eye(3)[None], count, axis=0)
        shared, exact = np.zeros((count, 3, 6)), np.zeros((6, 6))
        ids = self.filter.add_points(points, noise, shared, exact)
        self._adopt(ids, numbers)

    def step(self, frame: SimulatedFrame) -> UpdateReport:
        """Predicts to the frame, updates once, and looks after births and the map."""
        self.filter.predict(frame.time)
        seen = [i for i, point in self.features.items() if frame.visible[point]]
        ids = np.array(seen, np.int64)
        fresh = self._fresh(frame) if frame.views or frame.depths is not None else []
        worn = [self._worn(frame, view, who, seen, fresh) for who, view in enumerate(frame.views)]
        depths, measured = self._depths(frame, seen, fresh)
        report = self.filter.update(
            ids,
            ids,
            self._pixels(frame, [self.features[i] for i in seen]),
            views=[view for view, _ in worn],
            depths=depths,
        )
        for outcomes, (_, points) in zip(report.views, worn, strict=True):
            self._adopt(outcomes.born, points)
        self._adopt(report.depths.born, measured)
        if self.filter.started:
            self.look_after(frame)
        return report

    def look_after(self, frame: SimulatedFrame) -> None:
        """Delayed births, deletions, and new candidates where features lack."""
        f = self.filter
        taken = set(self.features.values())
        lost = [i for i, p in self._waiting.items() if not frame.visible[p] or p in taken]
        if lost:
            f.drop_candidates(np.array(lost, np.int64))
        for i in lost:
            del self._waiting[i]
        if self._waiting:
            numbers, ids = list(self._waiting.values()), np.array(list(self._waiting), np.int64)
            born = f.observe_candidates(ids, self._pixels(frame, numbers)).born
            self._adopt(born, numbers)
        for i in f.manage_map():
            del self.features[int(i)]
        alive = {int(i) for i in f.candidates}
        self._waiting = {i: p for i, p in self._waiting.items() if i in alive}
        fresh = self._fresh(frame)
        if fresh:
            self._waiting.update(
                zip(map(int, f.add_candidates(self._pixels(frame, fresh))), fresh, strict=True)
            )

    def _fresh(self, frame: SimulatedFrame) -> list[int]:
        """Visible points that the filter has not, as many as it lacks."""
        visible = set(np.flatnonzero(frame.visible).tolist())
        new = visible.difference(self.features.values(), self._waiting.values())
        lacking = self._in_view - (len(visible) - len(new))
        return sorted(new)[: max(lacking, 0)]

    def _worn(
        self, frame: SimulatedFrame, view: SimulatedView, who: int, seen: list[int], fresh: list[int]
    ) -> tuple[WornMeasurement, list[int]]:
        t_cf, covariance, uv_f, visible_f = view
        known = [(i, self.features[i]) for i in seen if visible_f[self.features[i]]]
        both = known + [(-1, p) for p in [*self._waiting_in(frame), *fresh] if visible_f[p]]
        points = [p for _, p in both]
        ids = np.array([i for i, _ in both], np.int64)
        uv = self._pixels(frame, points)
        uv_f = uv_f[points].reshape(-1, 2)
        return WornMeasurement(t_cf, covariance, ids, uv, uv_f, who=who), points

    def _depths(
        self, frame: SimulatedFrame, seen: list[int], fresh: list[int]
    ) -> tuple[DepthMeasurement | None, list[int]]:
        if frame.depths is None:
            return None, []
        depth, sigma = frame.depths
        both = [(i, self.features[i]) for i in seen] + [(-1, p) for p in [*self._waiting_in(frame), *fresh]]
        points = [p for _, p in both]
        ids = np.array([i for i, _ in both], np.int64)
        return DepthMeasurement(ids, self._pixels(frame, points), depth[points], sigma[points]), points

    def _waiting_in(self, frame: SimulatedFrame) -> list[int]:
        return [p for p in self._waiting.values() if frame.visible[p]]

    def _adopt(self, ids: NDArray[np.int64], numbers: list[int]) -> None:
        self.features.update({int(i): p for i, p in zip(ids, numbers, strict=True) if i >= 0})

    @staticmethod
    def _pixels(frame: SimulatedFrame, numbers: list[int]) -> Array:
        return frame.uv[numbers].reshape(-1, 2)

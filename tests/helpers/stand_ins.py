"""A recording in memory and an engine that knows its truth, for tests of what stands around both."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from collabslam import geometry as g
from collabslam._core import Camera
from collabslam.errors import DataError
from collabslam.results import Landmarks, StepResult
from collabslam.types import Frame, Status, WornView


class Walk:
    """A recording in memory, 10 Hz; Cf is there in the first half."""

    name, source, target = "walk", "memory", None

    def __init__(self, frames: int = 30, breaks_at: int | None = None) -> None:
        self.camera = Camera("pinhole", 32, 24, (30.0, 30.0, 15.5, 11.5), [])
        self.worn_camera = self.camera
        self.times = 0.1 * np.arange(frames)
        self.truth = np.array(
            [g.se3_exp([0.1 * np.sin(k), 0, 0.1 * k, 0, 0.01 * k, 0]) for k in range(frames)]
        )
        self._breaks_at = breaks_at

    def __len__(self) -> int:
        return len(self.times)

    def image(self, i: int) -> np.ndarray:
        return np.zeros((24, 32), np.uint8)

    def frame(self, i: int) -> Frame:
        if i == self._breaks_at:
            raise DataError("The image 7.png is broken; replace it.")
        view = WornView(self.image(i), np.eye(4), np.eye(6) * 1e-4)
        return Frame(i, float(self.times[i]), self.image(i), (view,) if i < len(self) // 2 else ())


class FakeSlam:
    """Knows the truth, makes it a little too long, and loses it from a frame on."""

    def __init__(
        self,
        recording: Walk,
        *,
        scale: float = 1.05,
        lost_from: int = 10**6,
        stop_at: int = -1,
        degraded: range = range(0),
    ) -> None:
        self._recording, self._scale, self._lost_from, self._stop_at = recording, scale, lost_from, stop_at
        self._degraded = degraded
        self._frame = 0

    def step(self, t: float, image: np.ndarray, views: Sequence[WornView] = ()) -> StepResult:
        k = self._frame
        self._frame += 1
        if k == self._stop_at:
            raise KeyboardInterrupt
        pose = self._recording.truth[k].copy()
        pose[:3, 3] = self._scale * (pose[:3, 3])
        degraded = k in self._degraded
        status = Status.LOST if k >= self._lost_from else Status.DEGRADED if degraded else Status.OK
        diagnostics = {"accepted": 20, "overlap": bool(views), "depth_rows": 3 if views else 0,
                       "ms_update": 1.0, "ms_total": 2.0, "nis": 30.0, "nis_dof": 40,
                       "degraded_by": "matches" if degraded else ""}  # fmt: skip
        return step_result(t, pose, np.eye(6) * (1e-3 * (k + 1)), diagnostics, status)

    def landmarks(self) -> Landmarks:
        points = np.array([[1.0, 0.0, 2.0], [-1.0, 0.5, 3.0]])
        return Landmarks(np.arange(2), points, np.tile(np.eye(3) * 1e-3, (2, 1, 1)))


def step_result(
    t: float,
    pose: np.ndarray,
    covariance: np.ndarray,
    diagnostics: dict[str, Any],
    status: Status = Status.OK,
    *,
    started: bool = True,
) -> StepResult:
    """An answer made by hand, as of an engine in metres that has closed no loop."""
    return StepResult(
        t=t,
        pose=pose,
        covariance=covariance,
        status=status,
        valid=started and status is not Status.LOST,
        started=started,
        metric=True,
        scale_sd=0.01,
        pose_map=pose,
        covariance_map=covariance,
        diagnostics=diagnostics,
    )

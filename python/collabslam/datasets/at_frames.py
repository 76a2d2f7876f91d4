"""Views of Cf that run on a clock of their own, each at the frame nearest to it in time."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from collabslam import _core
from collabslam.datasets.poses import interpolate_track
from collabslam.datasets.wrapped import TOGETHER, WrappedRecording
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Frame, Recording, WornView

REACH = 0.075
"""Seconds from a frame in which a view of Cf at 7 Hz lies; of frames at a lower rate, half their distance."""
LATEST = 1.0
"""Seconds after which a view is not waited for."""
MOTION = (1.0, 0.5)
"""Of Cs between a view and its frame where no poses tell it: standard deviations, m/s and rad/s."""
_ASKED = 24
"""Frames that tell whether Cf has a clock of its own."""
_KEPT = 32
"""Frames that are kept."""


class AtFrames(WrappedRecording):
    """A recording of one Cf whose frames carry the views nearest to them, with ``T_CF`` as it was there.

    In the recording itself a view comes with the first frame after it, or a later one.  Here a frame has the
    view nearest to it, whose pose is carried there along the poses of Cs; without these it stays, and its
    covariance grows by the motion there may have been (`MOTION`).

    Parameters
    ----------
    base : Recording
    poses : (N, 4, 4) float64, optional
        T_WC of its frames, metres, NaN where unknown.

    Attributes
    ----------
    free : bool
        Whether views are more than 10 ms from the frames that bring them; if not, nothing is changed.
    """

    def __init__(self, base: Recording, poses: Array | None = None) -> None:
        super().__init__(base)
        between = float(np.median(np.diff(base.times))) if len(base) > 1 else 0.0
        self._reach = max(REACH, 0.5 * between)
        self._read = lru_cache(maxsize=_KEPT)(base.frame)
        known = np.zeros(len(base), np.bool_) if poses is None else np.isfinite(poses).all(axis=(1, 2))
        self._stamps: Array = base.times[known]
        self._poses: Array = np.empty((0, 4, 4)) if poses is None else poses[known]
        asked = np.unique(np.linspace(0, len(base) - 1, min(_ASKED, len(base))).astype(int)).tolist()
        self.free = any(not self._is_together(self._read(i)) for i in asked)

    def frame(self, i: int) -> Frame:
        """Frame ``i`` with the view nearest to it, if one is near."""
        frame = self._read(i)
        if not self.free:
            return frame
        worn = self._nearest(i)
        return replace(frame, worn=None if worn is None else self._carried(worn, frame.t))

    @staticmethod
    def _is_together(frame: Frame) -> bool:
        return frame.worn is None or frame.worn.t is None or abs(frame.worn.t - frame.t) <= TOGETHER

    def _nearest(self, i: int) -> WornView | None:
        t, best = float(self.times[i]), None
        for j in range(i, len(self)):
            if self.times[j] > t + LATEST:
                break
            worn = self._read(j).worn
            if worn is None:
                continue
            taken = float(self.times[j]) if worn.t is None else worn.t
            off = abs(taken - t)
            if off <= self._reach and (best is None or off < abs(best[0] - t)):
                best = taken, worn
            if taken >= t:
                break
        return None if best is None else replace(best[1], t=best[0])

    def _carried(self, worn: WornView, t: float) -> WornView:
        taken = t if worn.t is None else worn.t
        if abs(taken - t) <= TOGETHER:
            return worn
        if len(self._stamps):
            here, there = interpolate_track(self._stamps, self._poses, np.array([t, taken]))
            if np.isfinite([here, there]).all():
                return replace(worn, t_cf=pose_inverse(here) @ there @ worn.t_cf)
        moved = np.repeat(MOTION, 3) * abs(taken - t)
        back = _core.adjoint(pose_inverse(worn.t_cf))
        return replace(worn, covariance=worn.covariance + back @ np.diag(moved**2) @ back.T)

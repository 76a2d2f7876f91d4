"""Where odometry says that it went: its samples, one after the other (METHOD section 23)."""

from __future__ import annotations

import numpy as np

from collabslam._core import ODOMETRY_GAP
from collabslam.datasets.odometry import UNMEASURED
from collabslam.geometry import pose_inverse, se3_exp
from collabslam.types import Array, Odometry


class DeadReckoning:
    """Odometry, followed once, to be asked for the motion between any two times.

    Parameters
    ----------
    odometry : Odometry
        What was not measured counts as zero.
    """

    def __init__(self, odometry: Odometry) -> None:
        times = odometry.times
        measured = np.diagonal(odometry.covariances, axis1=1, axis2=2) < UNMEASURED
        self._times, self._twists = times, np.where(measured, odometry.twists, 0.0)
        steps = np.diff(times)
        self._gaps = np.concatenate([[0], np.cumsum(steps > ODOMETRY_GAP)])
        speeds = np.linalg.norm(self._twists[1:, :3], axis=1)
        self._ways = np.concatenate([[0.0], np.cumsum(speeds * steps)])
        poses = [np.eye(4)]
        for twist, step in zip(self._twists[1:], steps, strict=True):
            poses.append(poses[-1] @ se3_exp(twist * min(step, ODOMETRY_GAP)))
        self._poses = np.asarray(poses)

    def way(self, first: float, second: float) -> float:
        """Length of the way between two times, metres; NaN where samples do not cover all of it."""
        if not self._covered(first, second):
            return np.nan
        start, end = np.interp([first, second], self._times, self._ways)
        return float(end - start)

    def between(self, first: float, second: float) -> Array | None:
        """T_ab (4, 4), maps points of B at the second time into B at the first; None as `way` is NaN."""
        if not self._covered(first, second):
            return None
        return np.asarray(pose_inverse(self._at(first)) @ self._at(second))

    def _covered(self, first: float, second: float) -> bool:
        if not self._times[0] <= first < second <= self._times[-1]:
            return False
        before = int(np.searchsorted(self._times, first, side="right")) - 1
        after = int(np.searchsorted(self._times, second, side="left"))
        return bool(self._gaps[before] == self._gaps[after])

    def _at(self, t: float) -> Array:
        k = min(int(np.searchsorted(self._times, t, side="right")) - 1, len(self._times) - 2)
        return np.asarray(self._poses[k] @ se3_exp(self._twists[k + 1] * (t - self._times[k])))

"""Whole recordings of scans and attitudes, in order of time."""

from __future__ import annotations

from collections.abc import Iterable

from collabslam.worn_pose.estimator import WornPoseEstimator
from collabslam.worn_pose.readings import AhrsReading, LaserScan, WornPoseEstimate


def estimates_at(
    times: Iterable[float],
    estimator: WornPoseEstimator,
    scans: Iterable[LaserScan],
    readings: Iterable[AhrsReading],
) -> list[WornPoseEstimate]:
    """Estimates at the stamps of images.

    Each uses the scans up to its stamp and no later one, as a running system would; attitudes are
    interpolated between the readings on both sides of it.

    Parameters
    ----------
    times : iterable of float
        Seconds, increasing.
    estimator : WornPoseEstimator
    scans : iterable of LaserScan
        Of all scanners; sorted here.
    readings : iterable of AhrsReading
        Of both AHRSs; sorted here.

    Raises
    ------
    InputError
        If two scans or readings of one sensor have the same stamp, or a scanner is unknown.
    """
    waiting = sorted(scans, key=_middle)
    attitudes = sorted(readings, key=lambda r: r.t)
    ahead = 2.0 * estimator.config.max_ahrs_age
    i = j = 0
    out = []
    for t in times:
        while i < len(waiting) and _middle(waiting[i]) <= t:
            j = _attitudes_up_to(_middle(waiting[i]) + ahead, attitudes, j, estimator)
            estimator.add_scan(waiting[i])
            i += 1
        j = _attitudes_up_to(t + ahead, attitudes, j, estimator)
        out.append(estimator.pose_at(t))
    return out


def _middle(scan: LaserScan) -> float:
    return scan.t + 0.5 * scan.time_increment * (len(scan.ranges) - 1)


def _attitudes_up_to(t: float, readings: list[AhrsReading], j: int, estimator: WornPoseEstimator) -> int:
    while j < len(readings) and readings[j].t <= t:
        estimator.add_ahrs(readings[j])
        j += 1
    return j

"""Whole recordings of scans and attitudes, in order of time."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from collabslam.errors import InputError
from collabslam.worn_pose.estimator import WornPoseEstimator
from collabslam.worn_pose.readings import AhrsReading, LaserScan, Wearer, WornPoseEstimate


def laser_scans(
    times: ArrayLike,
    ranges: ArrayLike,
    angle_min: float,
    angle_increment: float,
    *,
    scanner: str = "front",
    range_min: float = 0.0,
    range_max: float = 1e3,
    time_increment: float = 0.0,
) -> list[LaserScan]:
    """Scans of one scanner from arrays.

    Parameters
    ----------
    times : (N,) array
        Of the first beams, seconds.
    ranges : (N, K) array
        Metres; infinite where a beam met nothing up to ``range_max``, NaN where it tells nothing.
    angle_min, angle_increment, scanner, range_min, range_max, time_increment
        As in `LaserScan`.

    Raises
    ------
    InputError
        If the shapes do not fit or a value is not possible.
    """
    stamps, rows = np.asarray(times, np.float64), np.asarray(ranges, np.float64)
    if stamps.ndim != 1 or rows.ndim != 2 or len(stamps) != len(rows):
        raise InputError(f"Scans need times (N,) and ranges (N, K); got {stamps.shape} and {rows.shape}.")
    rest = (angle_min, angle_increment, scanner, range_min, range_max, time_increment)
    return [LaserScan(t, row, *rest) for t, row in zip(stamps.tolist(), rows, strict=True)]


def ahrs_readings(times: ArrayLike, q_xyzw: ArrayLike, where: Wearer) -> list[AhrsReading]:
    """Readings of one AHRS from arrays: times (N,), seconds, and quaternions (N, 4), x y z w as in ROS.

    Raises
    ------
    InputError
        If the shapes do not fit or a quaternion is not a unit one.
    """
    stamps, rows = np.asarray(times, np.float64), np.asarray(q_xyzw, np.float64)
    if stamps.ndim != 1 or rows.shape != (len(stamps), 4):
        raise InputError(f"Attitudes need times (N,) and q_xyzw (N, 4); got {stamps.shape} and {rows.shape}.")
    return [AhrsReading(t, row, where) for t, row in zip(stamps.tolist(), rows, strict=True)]


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

"""What was recorded beside the images, given to the engine before the frame that needs it; its numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from collabslam.evaluation.record import RunRecord
from collabslam.slam.engine import Slam
from collabslam.types import ImuLog, Odometry, Recording

LONGEST_BEFORE = 2.0
"""Seconds of samples before the first frame that a run begins with."""
SURE = 3.0
"""Standard deviations of a clock's offset for which samples are given ahead."""


def give_sensors(slam: Slam, recording: Recording, t: float, *, metric: bool) -> None:
    """Gives the samples that a frame at ``t``, seconds, needs; odometry only where lengths are ``metric``."""
    odometry: Odometry | None = getattr(recording, "odometry", None)
    if odometry is not None and metric:
        give_odometry(slam, odometry, t)
    log: ImuLog | None = getattr(recording, "imu", None)
    if log is not None:
        give_gyro(slam, log, t)


def give_odometry(slam: Slam, odometry: Odometry, t: float) -> None:
    """Gives the samples that a frame at ``t`` needs: since the last one given, and one after it."""
    last = slam.filter.odometry_time
    begin = t - LONGEST_BEFORE if last is None else last
    first = int(np.searchsorted(odometry.times, begin, side="right"))
    until = int(np.searchsorted(odometry.times, t, side="left")) + 1
    for k in range(first, min(until, len(odometry))):
        slam.add_odometry(float(odometry.times[k]), odometry.twists[k], odometry.covariances[k])


def give_gyro(slam: Slam, log: ImuLog, t: float) -> None:
    """Gives the samples that a frame at ``t`` needs: since the last one given, and so far after it as the
    clock may be off, and one more."""
    clock, last = slam.filter.gyro_clock, slam.filter.gyro_time
    if clock is None:  # an engine of one's own that was made without a gyroscope
        return
    offset, sd = clock
    begin = t - offset - LONGEST_BEFORE if last is None else last
    first = int(np.searchsorted(log.times, begin, side="right"))
    until = int(np.searchsorted(log.times, t - offset + SURE * sd, side="left")) + 1
    for k in range(first, min(until, len(log))):
        slam.add_gyro(float(log.times[k]), log.rates[k])


def gyro_numbers(engine: object, recording: Recording, record: RunRecord) -> dict[str, Any] | None:
    """For ``summary.json``: samples of the gyroscope and those left out, frames that it turned and those
    whose images contradict it, whether it was followed to the end, and its bias, rad/s, and clock, seconds,
    as the filter knows them then; None without one."""
    log: ImuLog | None = getattr(recording, "imu", None)
    if log is None or not isinstance(engine, Slam) or engine.filter.gyro_bias is None:
        return None
    bias, covariance = engine.filter.gyro_bias
    offset, offset_sd = engine.filter.gyro_clock or (None, None)
    return {
        "samples": len(log),
        "left_out": log.left_out,
        "frames": int(np.nansum(record.diagnostic("gyro_used"))),
        "contradicted": int(np.nansum(record.diagnostic("gyro_contradicted"))),
        "followed": bool(engine.filter.follows_gyro),
        "bias_rad_s": bias.tolist(),
        "bias_sd_rad_s": np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist(),
        "clock_offset_s": offset,
        "clock_offset_sd_s": offset_sd,
    }


def worn_gyro_numbers(record: RunRecord) -> dict[str, int] | None:
    """For ``summary.json``: views whose own gyroscope told how they turned, ``used``, and those that
    ``contradicted`` it; None where no view told it."""
    used, contradicted = (
        int(np.nansum(record.diagnostic(name))) for name in ("cf_rate_used", "cf_rate_contradicted")
    )
    return {"used": used, "contradicted": contradicted} if used or contradicted else None

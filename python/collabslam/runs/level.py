"""Which way is down in a recording: as its accelerometer says, or as it is told."""

from __future__ import annotations

import numpy as np

from collabslam.datasets.odometry import mounted
from collabslam.errors import SettingsError
from collabslam.evaluation.record import RunRecord
from collabslam.level import Level
from collabslam.settings.table import Settings
from collabslam.slam.inertial_samples import InertialSamples
from collabslam.slam.level_estimator import LevelEstimator
from collabslam.types import ImuLog

LEVEL, WORLD_NOTE = "level", "world"
"""What the option says that asks for it, and the name that it has in the summary's options."""
TOLD_SD = np.deg2rad(1.0)
"""Of each angle that is told without one."""


def parse_world(text: str) -> Level | None:
    """``level``: as the accelerometer has it, None; ``level:ROLL,PITCH[,SD]``: told, degrees.

    Roll and pitch are those of Cs at the start, about the axes x ahead and y left of a camera that looks
    ahead: one that looks down by 10 degrees has a pitch of 10.

    Raises
    ------
    SettingsError
        If it is neither.
    """
    kind, _, rest = text.partition(":")
    try:
        angles = [float(part) for part in rest.split(",")] if rest else []
    except ValueError:
        angles = [np.nan]
    if kind != LEVEL or len(angles) not in (0, 2, 3) or not np.isfinite(angles).all():
        raise SettingsError(f"The world '{text}' is not known; give level, or level:ROLL,PITCH (degrees).")
    if not angles:
        return None
    sd = np.deg2rad(angles[2]) if len(angles) == 3 else TOLD_SD
    if not sd > 0.0:
        raise SettingsError(f"The standard deviation of '{text}' is not above zero; give some degrees.")
    up = mounted((0.0, 0.0, 0.0, angles[0], angles[1], 0.0))[:3, :3].T @ np.eye(3)[2]
    return Level(up, sd**2 * np.eye(2), "told")


def measured_level(
    record: RunRecord, log: ImuLog | None, settings: Settings, *, metric: bool
) -> Level | None:
    """Up in W by the accelerometer at rest, or in the mean over the way.

    None without an accelerometer, or if what it says is too short or no gravity.
    """
    if log is None or log.accelerations is None:
        return None
    forces, rates = InertialSamples(), InertialSamples()
    estimator = LevelEstimator(settings.replace(log.sensor.sizes).filter.imu, forces, rates, metric=metric)
    estimator.sits(log.sensor)
    finite = np.isfinite(log.accelerations).all(axis=1)
    forces.add_all(log.times[finite], log.accelerations[finite])
    rates.add_all(log.times, log.rates)
    frames = zip(record.times.tolist(), record.poses, record.covariances, record.valid.tolist(), strict=True)
    for t, t_wc, covariance, usable in frames:
        estimator.frame(t, t_wc, covariance, usable=usable)
    estimator.finish()
    return estimator.level()

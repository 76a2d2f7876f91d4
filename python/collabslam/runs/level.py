"""Which way is down: two angles of W with their covariance, by an accelerometer or as they are told.

At rest an accelerometer shows up with 9.8 m/s^2; in the mean over a way it does, too, but for the change of
velocity, which the poses tell where lengths are metres.  The level world L has W's origin, its axes are x
ahead, y left, z up, and x is where W's camera looked, seen from above.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from collabslam.datasets.odometry import mounted
from collabslam.errors import SettingsError
from collabslam.evaluation.record import RunRecord
from collabslam.geometry import pose, rotation_exp, rotation_log, skew
from collabslam.results import Landmarks
from collabslam.settings.table import Settings
from collabslam.types import Array, ImuLog

LEVEL, WORLD_NOTE = "level", "world"
"""What the option says that asks for it, and the name that it has in the summary's options."""
G = 9.81
"""m/s^2."""
LONGEST = 1.0
"""Seconds between two frames over which accelerations are averaged."""
REST, AROUND, LEAST_REST = (0.15, 0.02), 0.5, 1.0
"""Standard deviations of acceleration, m/s^2, and rate, rad/s, below which a sensor rests, if they are so
from so many seconds before to as many after; and the seconds of rest that are enough to tell."""
LEAST_WAY = 5.0
"""Seconds of a way whose mean tells."""
NO_GRAVITY = 0.5
"""m/s^2 by which the mean may differ from gravity."""
SPEED_SD = 0.2, 1.5
"""Standard deviations of a change of velocity that the poses tell, and of one that nothing does, m/s."""
TREMBLE = 0.03
"""m/s^2 that is left of the motion of a sensor that rests."""
TOLD_SD = np.deg2rad(1.0)
_SIDE = np.eye(3)[:, :2]


@dataclass(frozen=True)
class Level:
    """The direction of up in W, and how well it is known.

    Attributes
    ----------
    up : (3,) float64
        A unit vector along the axes of W.
    covariance : (2, 2) float64
        Of the turns about the level world's x and y, rad^2.
    source : str
        What tells it.
    """

    up: Array
    covariance: Array
    source: str

    @property
    def r_lw(self) -> Array:
        """(3, 3), maps directions of W into the level world."""
        ahead = np.eye(3)[2] - self.up[2] * self.up
        if np.linalg.norm(ahead) < 0.1:  # it looks straight up or down: what is up in the image is ahead
            ahead = -np.eye(3)[1] + self.up[1] * self.up
        x = ahead / np.linalg.norm(ahead)
        return np.stack([x, np.cross(self.up, x), self.up])

    def poses(self, poses: Array, covariances: Array) -> tuple[Array, Array]:
        """T_LC (N, 4, 4) of T_WC, and their covariances (N, 6, 6) then, on the right tangent."""
        moved = pose(self.r_lw, np.zeros(3)) @ poses
        out = []
        for t_lc, covariance in zip(moved, covariances, strict=True):
            back = t_lc[:3, :3].T
            by_level = np.concatenate([-back @ skew(t_lc[:3, 3]), back]) @ _SIDE
            out.append(covariance + by_level @ self.covariance @ by_level.T)
        return moved, np.asarray(out).reshape(-1, 6, 6)

    def landmarks(self, landmarks: Landmarks) -> Landmarks:
        """The map in the level world."""
        turn = self.r_lw
        points = landmarks.points @ turn.T
        out = []
        for point, covariance in zip(points, landmarks.covariance, strict=True):
            by_level = -skew(point) @ _SIDE
            out.append(turn @ covariance @ turn.T + by_level @ self.covariance @ by_level.T)
        return replace(landmarks, points=points, covariance=np.asarray(out).reshape(-1, 3, 3))

    def numbers(self) -> dict[str, Any]:
        """For ``summary.json``: up in W, roll and pitch of its camera, degrees, their standard deviation."""
        x, y, z = self.up.tolist()
        return {
            "up": [x, y, z],
            "roll_deg": float(np.rad2deg(np.arctan2(-x, -y))),
            "pitch_deg": float(np.rad2deg(np.arctan2(-z, np.hypot(x, y)))),
            "sd_deg": float(np.rad2deg(np.sqrt(np.trace(self.covariance) / 2.0))),
            "source": self.source,
        }


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


class _Interval(NamedTuple):
    """What was measured from frame ``k`` to the next: the mean specific force along the axes of W, m/s^2, how
    long, seconds, the variance of up that the frame's attitude claims, rad^2 about an axis, and whether the
    sensor may have rested."""

    k: int
    force: Array
    seconds: float
    drift: float
    still: bool


def measured_level(
    record: RunRecord, log: ImuLog | None, settings: Settings, *, metric: bool
) -> Level | None:
    """Up in W by the accelerometer at rest, or in the mean over the way.

    None without an accelerometer, or if what it says is too short or no gravity.
    """
    if log is None or log.accelerations is None:
        return None
    sizes = settings.replace(log.sensor.sizes).filter.imu
    bias, mount = sizes.accel_bias_sd, sizes.mount_sd
    every = list(_intervals(record, log))
    resting = [one for one in every if one.still]
    seconds = sum(one.seconds for one in resting)
    at_rest = seconds >= LEAST_REST
    if at_rest:
        mean, drift = _mean(resting, max((bias / G) ** 2, 1e-6))
        sd, how = TREMBLE, "at rest"
    else:
        seconds = sum(one.seconds for one in every)
        if seconds < LEAST_WAY:
            return None
        change, stretches = _velocity_change(record, every)
        mean, drift = _mean(every, np.inf)
        mean = mean - (change / seconds if metric else 0.0)
        sd, how = SPEED_SD[0 if metric else 1] * np.sqrt(2.0 * stretches) / seconds, "in the mean"
    size = float(np.linalg.norm(mean))
    if abs(size - G) > NO_GRAVITY + 3.0 * float(np.hypot(sd, bias)):
        return None
    variance = (sd**2 + bias**2) / G**2 + drift + mount**2
    return Level(mean / size, variance * np.eye(2), f"accelerometer, {how} over {seconds:.1f} s")


def _mean(used: list[_Interval], floor: float) -> tuple[Array, float]:
    """Mean force of intervals, those whose attitude has drifted less than ``floor`` (rad^2) weighted alike,
    and the variance by that drift, which is taken to be one and the same error in all of them."""
    drift = np.array([one.drift for one in used])
    weight = np.array([one.seconds for one in used]) / (1.0 + drift / floor)
    weight /= weight.sum()
    return weight @ np.array([one.force for one in used]), float(weight @ np.sqrt(drift)) ** 2


def _intervals(record: RunRecord, log: ImuLog) -> Iterator[_Interval]:
    """From each valid frame to the next."""
    assert log.accelerations is not None
    times, poses, valid = record.times, record.poses, record.valid
    finite = np.isfinite(log.accelerations).all(axis=1)
    stamps = (log.times + log.sensor.time_offset)[finite]
    forces, rates = log.accelerations[finite], log.rates[finite]
    at, early, late = (np.searchsorted(stamps, times + shift) for shift in (0.0, -AROUND, AROUND))
    for k in np.flatnonzero(valid[:-1] & valid[1:] & (np.diff(times) <= LONGEST)).tolist():
        a, b = int(at[k]), int(at[k + 1])
        if b - a < 2:
            continue
        half = 0.5 * rotation_log(poses[k, :3, :3].T @ poses[k + 1, :3, :3])
        turn = poses[k, :3, :3] @ rotation_exp(half) @ np.asarray(log.sensor.r_ci)
        mean, near = forces[a:b].mean(axis=0), slice(int(early[k]), int(late[k + 1]))
        restless = float(forces[near].std(axis=0).max()), float(rates[near].std(axis=0).max())
        still = restless[0] < REST[0] and restless[1] < REST[1]
        still = still and abs(float(np.linalg.norm(mean)) - G) < NO_GRAVITY
        force, spread = turn @ mean, record.covariances[k, 3:, 3:]
        up = poses[k, :3, :3].T @ force / np.linalg.norm(force)
        drift = 0.5 * float(np.trace(spread) - up @ spread @ up)  # a turn about up leaves it where it is
        yield _Interval(k, force, float(times[k + 1] - times[k]), drift, still)


def _velocity_change(record: RunRecord, used: list[_Interval]) -> tuple[Array, int]:
    """Change of the velocity from the beginning to the end of each stretch of intervals, summed, in units of
    length a second; and how many stretches there are."""
    times, places = record.times, record.poses[:, :3, 3]
    speeds = {k: (places[k + 1] - places[k]) / (times[k + 1] - times[k]) for k in (one.k for one in used)}
    first, last = ([k for k in speeds if k + step not in speeds] for step in (-1, 1))
    change = sum((speeds[k] for k in last), np.zeros(3)) - sum((speeds[k] for k in first), np.zeros(3))
    return change, len(first)

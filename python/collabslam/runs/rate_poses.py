"""Poses and velocities between frames, at the rate of a gyroscope, after a run.

From frame to frame the attitude goes as the gyroscope says, and what it misses at the next frame is spread
evenly over the time between; the position goes on a cubic whose ends and velocities are those of the frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collabslam._core import GYRO_GAP
from collabslam.evaluation.record import RunRecord
from collabslam.formats.files import write_text
from collabslam.formats.trajectory import position_quaternion
from collabslam.geometry import pose, rotation_exp, rotation_log
from collabslam.settings.table import Settings
from collabslam.types import Array, ImuLog, Mask

LONGEST = 1.0
"""Seconds between two frames over which nothing is said."""
RATE_NOTE = "rate_poses"
"""Its name in the summary's options."""
_TRIANGLE = np.tril_indices(6)
_HEADER = (
    "# T_WC (lengths in {unit}), velocity along the axes of W, angular velocity along those of C, rad/s, "
    "and the covariance\n# of the pose, lower triangle row by row over x y z rx ry rz, tangent on the right\n"
    "t,x,y,z,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz,"
    + ",".join(f"c{i + 1}{j + 1}" for i, j in zip(*_TRIANGLE, strict=True))
)


@dataclass(frozen=True)
class RatePose:
    """One sample's: ``t`` seconds by the frames' clock, T_WC (4, 4), its covariance (6, 6), tangent on the
    right, velocity in W (3,) and angular velocity along the axes of C (3,), rad/s."""

    t: float
    pose: Array
    covariance: Array
    velocity: Array
    angular_velocity: Array


def rate_poses(
    record: RunRecord, log: ImuLog, settings: Settings, bias: Array, time_offset: float
) -> Iterator[RatePose]:
    """One for each sample between two valid frames that samples cover without a gap.

    The covariance is a mean of those of the two frames, which no correlation of their errors exceeds, and
    what the gyroscope's noise (``imu.gyro_noise``) and accelerations (``process.acceleration_density``) may
    do between them.

    Parameters
    ----------
    record : RunRecord
    log : ImuLog
    settings : Settings
    bias : (3,) array
        Of the gyroscope, rad/s.
    time_offset : float
        Seconds to be added to its stamps.
    """
    r_ci = np.asarray(log.sensor.r_ci, np.float64)
    stamps, rates = log.times + time_offset, (log.rates - bias) @ r_ci.T
    noise = settings.replace(log.sensor.sizes).filter.imu.gyro_noise
    density = settings.filter.process.acceleration_density
    times, poses, covariances, valid = record.times, record.poses, record.covariances, record.valid
    velocities = _velocities(times, poses[:, :3, 3], valid)
    for k in np.flatnonzero(valid[:-1] & valid[1:] & (np.diff(times) <= LONGEST)).tolist():
        start, end, dt = times[k], times[k + 1], float(times[k + 1] - times[k])
        first, last = np.searchsorted(stamps, start, side="right"), np.searchsorted(stamps, end, side="left")
        if first == 0 or last == len(stamps) or np.diff(stamps[first - 1 : last + 1]).max() > GYRO_GAP:
            continue
        at = np.concatenate([[start], stamps[first:last], [end]])
        turning = np.stack(
            [np.interp(at, stamps[first - 1 : last + 1], axis) for axis in rates[first - 1 : last + 1].T],
            axis=1,
        )
        turns = [np.eye(3)]
        for step, mean in zip(np.diff(at), 0.5 * (turning[1:] + turning[:-1]), strict=True):
            turns.append(turns[-1] @ rotation_exp(mean * step))
        missed = rotation_log(turns[-1].T @ poses[k, :3, :3].T @ poses[k + 1, :3, :3])
        for i in range(1, len(at) - 1):
            s = float((at[i] - start) / dt)
            turn = poses[k, :3, :3] @ turns[i] @ rotation_exp(s * missed)
            place, speed = _cubic(s, dt, poses[[k, k + 1], :3, 3], velocities[[k, k + 1]])
            spread = np.diag(
                [*[(0.5 * density * dt**1.5 * s * (1 - s)) ** 2] * 3, *[noise**2 * dt * s * (1 - s)] * 3]
            )
            for share, j in ((1.0 - s, k), (s, k + 1)):
                moved = np.kron(np.eye(2), turn.T @ poses[j, :3, :3])
                spread = spread + share * moved @ covariances[j] @ moved.T
            yield RatePose(float(at[i]), pose(turn, place), spread, speed, turning[i] + missed / dt)


def write_rate_poses(path: Path, found: Iterator[RatePose], unit: str) -> int:
    """Writes a CSV, a line for each; returns how many there are."""
    lines = [_HEADER.format(unit=unit)]
    for one in found:
        numbers = [*position_quaternion(one.pose), *one.velocity, *one.angular_velocity]
        triangle = ",".join(f"{x:.9e}" for x in one.covariance[_TRIANGLE])
        lines.append(f"{one.t:.9f}," + ",".join(f"{x:.9f}" for x in numbers) + f",{triangle}")
    write_text(path, "\n".join(lines) + "\n")
    return len(lines) - 1


def _velocities(times: Array, places: Array, valid: Mask) -> Array:
    """At each frame the slope through its valid neighbours, (N, 3)."""
    out = np.zeros_like(places)
    for k in np.flatnonzero(valid).tolist():
        near = [
            j
            for j in (k - 1, k, k + 1)
            if 0 <= j < len(times) and valid[j] and abs(times[j] - times[k]) <= LONGEST
        ]
        if len(near) > 1:
            out[k] = (places[near[-1]] - places[near[0]]) / (times[near[-1]] - times[near[0]])
    return out


def _cubic(s: float, dt: float, ends: Array, slopes: Array) -> tuple[Array, Array]:
    """Place and velocity at a share of the way, by Hermite's cubic."""
    a, b = ends
    va, vb = slopes * dt
    place = (
        (1 + 2 * s) * (1 - s) ** 2 * a + s**2 * (3 - 2 * s) * b + s * (1 - s) ** 2 * va - s**2 * (1 - s) * vb
    )
    speed = 6 * s * (1 - s) * (b - a) + (1 - s) * (1 - 3 * s) * va + s * (3 * s - 2) * vb
    return place, speed / dt

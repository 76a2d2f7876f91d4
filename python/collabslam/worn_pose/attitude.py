"""Attitudes of one AHRS by time."""

from __future__ import annotations

from bisect import bisect_left
from math import acos, atan2, hypot, sin, sqrt

import numpy as np

from collabslam.errors import InputError
from collabslam.geometry import rotation_exp
from collabslam.types import Array
from collabslam.worn_pose.readings import AhrsReading

_BACK = 4
"""Readings over which a turn is extrapolated."""

Quaternion = tuple[float, float, float, float]


class AttitudeTrack:
    """The readings of an AHRS of the last seconds: interpolated between stamps, carried on past the last one.

    Parameters
    ----------
    name : str
        For messages.
    r_ahrs_camera : (3, 3) array
        Turns the camera's axes into the AHRS's.
    max_age : float
        Longest extrapolation, and half the longest gap to interpolate over, seconds.
    history : float
        Seconds to remember.
    tilt_share : float
        Share of the tilt to believe: less than 1 for a camera that is known to be nearly level.
    """

    def __init__(
        self, name: str, r_ahrs_camera: Array, max_age: float, history: float, tilt_share: float = 1.0
    ) -> None:
        self._tilt_share = tilt_share
        self._name, self._mount = name, np.asarray(r_ahrs_camera, np.float64)
        self._max_age, self._history = max_age, history
        self._times: list[float] = []
        self._q: list[Quaternion] = []

    def add(self, reading: AhrsReading) -> None:
        """Take a reading; InputError if it is not later than the last one."""
        if self._times and not reading.t > self._times[-1]:
            raise InputError(
                f"The {self._name} AHRS's reading at {reading.t} s is not later than the one before, at "
                f"{self._times[-1]} s; give readings in order of time."
            )
        x, y, z, w = reading.q_xyzw.tolist()
        norm = sqrt(x * x + y * y + z * z + w * w)
        if self._q:  # the nearer one of the two quaternions that mean the same
            a, b, c, d = self._q[-1]
            norm = -norm if a * x + b * y + c * z + d * w < 0.0 else norm
        self._times.append(reading.t)
        self._q.append((x / norm, y / norm, z / norm, w / norm))
        if len(self._times) > 64 and self._times[len(self._times) // 2] < reading.t - self._history:
            half = len(self._times) // 2
            del self._times[:half], self._q[:half]

    def at(self, t: float) -> Array | None:
        """R_NC (3, 3): turns the camera's axes into N at time t; None where the readings do not say."""
        read = self._read(t)
        return read if read is None or self._tilt_share == 1.0 else _levelled(read, self._tilt_share)

    def _read(self, t: float) -> Array | None:
        times = self._times
        k = bisect_left(times, t)
        if k < len(times) and times[k] == t:
            return _matrix(self._q[k]) @ self._mount
        if k == 0:
            return None
        if k < len(times):
            if times[k] - times[k - 1] > 2.0 * self._max_age:
                return None
            before = k - 1
            share = (t - times[before]) / (times[k] - times[before])
            return _matrix(_between(self._q[before], self._q[k], share)) @ self._mount
        if t - times[-1] > self._max_age:
            return None
        first = max(0, k - 1 - _BACK)
        if first == k - 1 or times[-1] - times[first] > self._max_age:
            return _matrix(self._q[-1]) @ self._mount
        share = (t - times[first]) / (times[-1] - times[first])
        return _matrix(_between(self._q[first], self._q[-1], share)) @ self._mount


def _between(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    """At a constant rate from a (share 0) through b (share 1), and past it."""
    cosine = min(1.0, sum(x * y for x, y in zip(a, b, strict=True)))
    angle = acos(max(-1.0, cosine))
    if angle < 1e-6:
        weights = (1.0 - share, share)
    else:
        weights = (sin((1.0 - share) * angle) / sin(angle), sin(share * angle) / sin(angle))
    x, y, z, w = (weights[0] * p + weights[1] * q for p, q in zip(a, b, strict=True))
    norm = sqrt(x * x + y * y + z * z + w * w)
    return x / norm, y / norm, z / norm, w / norm


def _matrix(q: Quaternion) -> Array:
    x, y, z, w = q
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def _levelled(r_nc: Array, share: float) -> Array:
    """R_NC with this share of its tilt."""
    x, y, z = (-r_nc[:, 1]).tolist()  # up, as the camera has it
    angle, size = atan2(hypot(x, y), z), max(hypot(x, y), 1e-12)
    turn = rotation_exp(np.array([y, -x, 0.0]) * ((1.0 - share) * angle / size))
    return np.asarray(turn @ r_nc)

"""Where Cs is after the last frame: turned by the gyroscope's samples, carried on at constant velocity."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from collabslam._core import GYRO_GAP
from collabslam.geometry import pose, rotation_exp, skew
from collabslam.types import Array

LONGEST = 0.5
"""Seconds after a frame beyond which nothing is said: constant velocity means little by then."""
_KEPT = 2000


@dataclass(frozen=True, eq=False)
class Motion:
    """What the filter knows after a frame, and of its gyroscope.

    Attributes
    ----------
    t : float
        Of the frame, seconds.
    pose : (4, 4) float64
        T_WC, metres.
    twist : (6,) float64
        Velocity and angular velocity of Cs along its own axes, m/s and rad/s.
    covariance : (12, 12) float64
        Of both, as `collabslam.Filter.pose_and_twist_covariance`.
    bias, bias_sd : (3,) float64
        Of the gyroscope, rad/s.
    time_offset : float
        Seconds to be added to its stamps.
    """

    t: float
    pose: Array
    twist: Array
    covariance: Array
    bias: Array
    bias_sd: Array
    time_offset: float


@dataclass(frozen=True, eq=False)
class Propagated:
    """A `Motion` at a later time ``t``: pose (4, 4), twist (6,), and the covariance (6, 6) of each."""

    t: float
    pose: Array
    covariance: Array
    twist: Array
    twist_covariance: Array


class Propagator:
    """Propagates the newest motion to the newest sample, at a bounded rate.

    One thread gives samples; ``motion`` may be set by another.

    Parameters
    ----------
    r_ci : (3, 3) array
        Turns vectors of the gyroscope into Cs.
    gyro_noise : float
        Density of its noise, rad/s/sqrt(Hz).
    acceleration_density : float
        Of the velocity's white noise, m/s^2/sqrt(Hz).
    rate : float
        Poses a second at most.
    """

    def __init__(self, r_ci: Array, gyro_noise: float, acceleration_density: float, rate: float) -> None:
        self.motion: Motion | None = None
        self._r_ci = np.asarray(r_ci, np.float64)
        self._gyro_noise, self._acceleration, self._step = gyro_noise, acceleration_density, 1.0 / rate
        self._samples: deque[tuple[float, Array]] = deque(maxlen=_KEPT)
        self._told = -np.inf

    def add(self, t: float, rate: Array) -> Propagated | None:
        """A sample: ``t`` seconds by the sensor's clock, ``rate`` (3,) along its axes, rad/s.

        Returns where Cs is at its time; None before the first motion, too soon after the last answer, where
        the samples have a gap, or too long after the frame.
        """
        self._samples.append((t, np.asarray(rate, np.float64)))
        motion = self.motion
        if motion is None:
            return None
        now = t + motion.time_offset
        while len(self._samples) > 2 and self._samples[1][0] + motion.time_offset <= motion.t:
            self._samples.popleft()
        late = now - motion.t
        if not 0.0 < late <= LONGEST or now - self._told < self._step * (1.0 - 1e-6):
            return None
        turned = self._turned(motion)
        if turned is None:
            return None
        self._told = now
        return self._moved(motion, now, *turned)

    def _turned(self, motion: Motion) -> tuple[Array, Array] | None:
        """The turn (3, 3) since the frame, and the rate (3,) now, along the axes of Cs; None for a gap."""
        times = np.array([t for t, _ in self._samples]) + motion.time_offset
        if times[0] > motion.t + GYRO_GAP or (np.diff(times) > GYRO_GAP).any():
            return None
        rates = (np.array([w for _, w in self._samples]) - motion.bias) @ self._r_ci.T
        first = int(np.searchsorted(times, motion.t, side="right"))
        at = np.concatenate([[motion.t], times[first:]])
        between = np.stack([np.interp(at, times, axis) for axis in rates.T], axis=1)
        turn = np.eye(3)
        for dt, mean in zip(np.diff(at), 0.5 * (between[1:] + between[:-1]), strict=True):
            turn = turn @ rotation_exp(mean * dt)
        return turn, rates[-1]

    def _moved(self, motion: Motion, now: float, turn: Array, rate: Array) -> Propagated:
        dt, back = now - motion.t, turn.T
        velocity = motion.twist[:3]
        place = motion.pose[:3, 3] + motion.pose[:3, :3] @ velocity * dt
        by = np.zeros((6, 12))  # of the pose now by pose and twist of the frame
        by[:3, :3], by[:3, 3:6], by[:3, 6:9] = back, -dt * back @ skew(velocity), dt * back
        by[3:, 3:6] = back
        unknown_rate = self._r_ci @ np.diag(motion.bias_sd**2) @ self._r_ci.T
        covariance = by @ motion.covariance @ by.T
        covariance[:3, :3] += np.eye(3) * self._acceleration**2 * dt**3 / 3.0
        covariance[3:, 3:] += np.eye(3) * self._gyro_noise**2 * dt + unknown_rate * dt**2
        spread = np.zeros((6, 6))
        spread[:3, :3] = back @ motion.covariance[6:9, 6:9] @ turn
        spread[:3, :3] += np.eye(3) * self._acceleration**2 * dt
        spread[3:, 3:] = unknown_rate + np.eye(3) * self._gyro_noise**2 / max(self._step, 1e-3)
        twist = np.concatenate([back @ velocity, rate])
        return Propagated(now, pose(motion.pose[:3, :3] @ turn, place), covariance, twist, spread)

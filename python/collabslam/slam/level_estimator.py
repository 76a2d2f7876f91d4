"""Which way is down by an accelerometer, while the frames come (METHOD 28).

At rest an accelerometer shows up with 9.8 m/s^2; in the mean over a way it does, too, but for the change of
velocity, which the poses tell where lengths are metres.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from collabslam._core import LAST_TIME, ImuSettings
from collabslam.errors import InputError
from collabslam.formats.schema import Check, array, covariance, items, number, optional, pose, whole
from collabslam.geometry import rotation_exp, rotation_log
from collabslam.level import GRAVITY, Level
from collabslam.slam.inertial_samples import InertialSamples, acceleration_of
from collabslam.slam.mean_force import FORCE_MEAN, VELOCITY_CHANGE, ForceMean, VelocityChange, row
from collabslam.slam.state import PersistentState
from collabslam.types import Array, Imu

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


class _Frame(NamedTuple):
    """A frame with a pose: its number, stamp, T_WC, and the covariance of its attitude."""

    number: int
    t: float
    pose: Array
    spread: Array


class LevelEstimator(PersistentState):
    """Takes frames as they are measured, and tells up in W as soon as an accelerometer does.

    What lies between two frames counts once a frame is `AROUND` seconds later.

    Parameters
    ----------
    sizes : ImuSettings
        Of the sensor's errors.
    forces, rates : InertialSamples
        Specific forces and rates along the sensor's axes, m/s^2 and rad/s.
    metric : bool
        Whether lengths are metres.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_r_ci": optional(array("<f8", 3, 3)),
        "_offset": number(),
        "_count": whole(0),
        "_frames": items(row(whole(0), number(-LAST_TIME, LAST_TIME), pose, covariance(3))),
        "_resting": FORCE_MEAN,
        "_every": FORCE_MEAN,
        "_change": VELOCITY_CHANGE,
    }

    def __init__(
        self, sizes: ImuSettings, forces: InertialSamples, rates: InertialSamples, *, metric: bool
    ) -> None:
        self._bias_sd, self._mount_sd = sizes.accel_bias_sd, sizes.mount_sd
        self._forces, self._rates, self._metric = forces, rates, metric
        self._r_ci: Array | None = None
        self._offset = 0.0
        self._count = 0
        self._frames: tuple[_Frame, ...] = ()
        self._resting, self._every, self._change = ForceMean(), ForceMean(), VelocityChange()

    def restore(self, state: Mapping[str, Any]) -> None:
        """As `PersistentState.restore`."""
        super().restore(state)
        self._frames = tuple(_Frame(*frame) for frame in self._frames)
        self._resting, self._every = ForceMean(*self._resting), ForceMean(*self._every)
        self._change = VelocityChange(*self._change)

    def sits(self, sensor: Imu) -> None:
        """Says how the sensor sits, and what its stamps lack to those of the frames."""
        self._r_ci, self._offset = np.array(sensor.r_ci, np.float64), float(sensor.time_offset)

    def add_acceleration(self, t: float, value: Any) -> None:
        """Takes a specific force; see `collabslam.Slam.add_acceleration`."""
        if self._r_ci is None:
            raise InputError(
                "An acceleration was given, and the engine was made without a sensor; say how it sits with "
                "imu=Imu(r_ci)."
            )
        force = acceleration_of(value)
        self._forces.check_next(t, "accelerometer")
        self._forces.add(t, force)

    def add_rate(self, t: float, value: Any) -> None:
        """Takes a rate that the filter has taken."""
        self._rates.add(t, np.asarray(value, np.float64))

    def frame(self, t: float, t_wc: Array, covariance: Array, *, usable: bool) -> None:
        """Takes a frame.

        Parameters
        ----------
        t : float
            Its stamp, seconds.
        t_wc, covariance : (4, 4), (6, 6) float64
            Its pose and that pose's covariance.
        usable : bool
            Whether the pose may be used.
        """
        self._forces.gather()
        self._rates.gather()
        number, self._count = self._count, self._count + 1
        if usable:
            self._frames = (*self._frames, _Frame(number, t, t_wc, covariance[3:, 3:]))
        self._take_until(t - AROUND)
        if len(self._frames) == 1 and t - self._frames[0].t > LONGEST:
            self._frames = ()  # nothing begins there any more
        first = self._frames[0].t if self._frames else t
        for samples in (self._forces, self._rates):
            samples.forget_before(first - AROUND - self._offset)

    def finish(self) -> None:
        """No frame will follow: what lies between the last ones counts, with the samples that there are."""
        self._take_until(np.inf)

    def _take_until(self, end: float) -> None:
        """Counts the intervals that end at ``end`` seconds or before."""
        while len(self._frames) > 1 and self._frames[1].t <= end:
            before, after = self._frames[:2]
            self._frames = self._frames[1:]
            if after.number == before.number + 1 and after.t - before.t <= LONGEST:
                self._count_in(before, after)

    def _count_in(self, before: _Frame, after: _Frame) -> None:
        """Counts what was measured from one frame to the next, if it can be used."""
        if self._r_ci is None or not len(self._forces):
            return
        begin, end = before.t - self._offset, after.t - self._offset
        forces, near = self._forces.between(begin, end), self._forces.between(begin - AROUND, end + AROUND)
        if len(forces) < 2 or not np.ptp(near, axis=0).any():  # a sensor that lives trembles
            return
        mean, rates = forces.mean(axis=0), self._rates.between(begin - AROUND, end + AROUND)
        if not mean.any():
            return
        still = len(rates) > 1 and bool(np.ptp(rates, axis=0).any())
        still = still and near.std(axis=0).max() < REST[0] and rates.std(axis=0).max() < REST[1]
        still = still and abs(float(np.linalg.norm(mean)) - GRAVITY) < NO_GRAVITY
        half = 0.5 * rotation_log(before.pose[:3, :3].T @ after.pose[:3, :3])
        force = before.pose[:3, :3] @ rotation_exp(half) @ self._r_ci @ mean
        up = before.pose[:3, :3].T @ force / np.linalg.norm(force)
        # A turn about up leaves it where it is.
        drift = max(0.5 * float(np.trace(before.spread) - up @ before.spread @ up), 0.0)
        seconds = after.t - before.t
        if still:
            floor = max((self._bias_sd / GRAVITY) ** 2, 1e-6)
            self._resting = self._resting.plus(seconds, force, drift, floor)
        self._every = self._every.plus(seconds, force, drift, np.inf)
        speed = (after.pose[:3, 3] - before.pose[:3, 3]) / seconds
        self._change = self._change.plus(before.number, speed)

    def level(self) -> Level | None:
        """Up in W; None where what the accelerometer says is too short, or no gravity."""
        bias, mount, every = self._bias_sd, self._mount_sd, self._every
        if self._resting.seconds >= LEAST_REST:
            seconds, how, sd = self._resting.seconds, "at rest", TREMBLE
            mean, drift = self._resting.mean()
        elif every.seconds >= LEAST_WAY:
            seconds, how = every.seconds, "in the mean"
            mean, drift = every.mean()
            mean = mean - (self._change.total / seconds if self._metric else 0.0)
            sd = SPEED_SD[0 if self._metric else 1] * np.sqrt(2.0 * self._change.stretches) / seconds
        else:
            return None
        size = float(np.linalg.norm(mean))
        if not abs(size - GRAVITY) <= NO_GRAVITY + 3.0 * float(np.hypot(sd, bias)):
            return None
        variance = (sd**2 + bias**2) / GRAVITY**2 + drift + mount**2
        return Level(mean / size, variance * np.eye(2), f"accelerometer, {how} over {seconds:.1f} s")

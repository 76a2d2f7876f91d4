"""A gyroscope in a rendered world: true rates with the errors of a good sensor, a phone's or a bad one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from collabslam._core import rotation_exp, rotation_log
from collabslam.types import Array, Imu, ImuLog

RATE = 200.0
"""Samples a second."""
BEFORE = 0.5
"""Seconds for which it runs before the first frame, and after the last one."""
R_CI = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Where it sits but for its errors, as in a phone that is held across: y to the left, z out of the screen."""

_DT = 1e-3


@dataclass(frozen=True)
class GyroKind:
    """How large a sensor's errors are: as `Imu` says them; those that last are drawn for each recording.

    Attributes
    ----------
    noise, bias_sd, walk : float
        rad/s/sqrt(Hz), rad/s, rad/s^2/sqrt(Hz).
    scale_sd : float
        Relative.
    mount_sd : float
        Of each angle, radians.
    clock_sd : float
        Seconds.
    """

    noise: float
    bias_sd: float
    walk: float
    scale_sd: float
    mount_sd: float
    clock_sd: float

    @property
    def stated(self) -> Imu:
        """What the filter is told of it: the sizes alone."""
        return Imu(
            R_CI,
            mount_sd=self.mount_sd,
            gyro_noise=self.noise,
            gyro_bias_sd=self.bias_sd,
            gyro_bias_walk=self.walk,
            gyro_scale_sd=self.scale_sd,
            time_offset_sd=self.clock_sd,
        )


KINDS = {
    "good": GyroKind(2e-4, 0.003, 1e-5, 0.002, np.deg2rad(0.1), 0.001),
    "phone": GyroKind(1e-3, 0.01, 1e-4, 0.005, np.deg2rad(0.5), 0.005),
    "bad": GyroKind(5e-3, 0.02, 5e-4, 0.01, np.deg2rad(2.0), 0.02),
}
"""Each by its name."""


@dataclass(frozen=True)
class SimulatedGyro:
    """What it measured, and what is wrong with it.

    Attributes
    ----------
    log : ImuLog
    biases : (N, 3) float64
        True bias at each sample, rad/s.
    offset : float
        What is to be added to its stamps, seconds.
    """

    log: ImuLog
    biases: Array
    offset: float

    def bias(self, t: float) -> Array:
        """(3,): the true bias at a stamp of the frames, rad/s."""
        last = np.searchsorted(self.log.times + self.offset, t, side="right") - 1
        return np.asarray(self.biases[max(last, 0)])


def true_rates(robot: Callable[[float], Array], times: Array) -> Array:
    """(N, 3): angular velocity of a camera along its own axes at each of the times, rad/s.

    Parameters
    ----------
    robot : callable
        True T_WC (4, 4) at a time, seconds.
    times : (N,) float64
    """
    turns = [robot(float(t) - _DT)[:3, :3].T @ robot(float(t) + _DT)[:3, :3] for t in times]
    return np.stack([rotation_log(turn) for turn in turns]) / (2.0 * _DT)


def simulated_gyro(
    robot: Callable[[float], Array], times: Array, kind: GyroKind, generator: np.random.Generator
) -> SimulatedGyro:
    """A sensor of a kind on a camera.

    Parameters
    ----------
    robot : callable
        True T_WC (4, 4) at a stamp of the frames, seconds.
    times : (N,) float64
        Stamps of the frames, seconds.
    kind : GyroKind
    generator : numpy Generator
        Draws its errors and its noise.
    """
    offset = kind.clock_sd * generator.standard_normal()
    scale = 1.0 + kind.scale_sd * generator.standard_normal()
    mount = rotation_exp(kind.mount_sd * generator.standard_normal(3)) @ R_CI
    bias = kind.bias_sd * generator.standard_normal(3)
    count = int((times[-1] - times[0] + 2.0 * BEFORE) * RATE)
    stamps = times[0] - BEFORE + np.arange(count) / RATE
    steps = kind.walk / np.sqrt(RATE) * generator.standard_normal((count, 3))
    biases = bias + np.cumsum(steps, axis=0)
    noise = kind.noise * np.sqrt(RATE) * generator.standard_normal((count, 3))
    rates = true_rates(robot, stamps + offset) @ mount / scale + biases + noise
    return SimulatedGyro(ImuLog(np.round(stamps, 9), rates, None, kind.stated), biases, offset)

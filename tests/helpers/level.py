"""A way with an accelerometer beside it: poses, and what the sensor says meanwhile."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from helpers.gyro import R_CI

from collabslam import Settings
from collabslam.geometry import pose, rotation_exp, rotation_log
from collabslam.level import GRAVITY, Level
from collabslam.types import Array, Imu, ImuLog

UP = np.array([0.1, -0.95, -0.3]) / np.linalg.norm([0.1, -0.95, -0.3])
SETTINGS = Settings.default()
RATE, FRAMES = 200, 20


def recorded(
    moving: float, *, seconds: float = 12.0, bias: Array | None = None, drift: float = 1e-6
) -> tuple[SimpleNamespace, ImuLog]:
    """Poses that sway and turn by ``moving`` of full swing, and what the sensor says meanwhile."""

    def place(t: Array) -> Array:
        return moving * np.stack([np.sin(1.3 * t), 0.1 * t**1.5, 0.7 * np.cos(0.9 * t)], axis=-1)

    def turn(t: float) -> Array:
        return rotation_exp(
            moving * np.array([0.3 * np.sin(t), 0.8 * np.sin(0.7 * t), 0.2 * np.sin(2.0 * t)])
        )

    times = np.arange(0.0, seconds, 1.0 / FRAMES)
    poses = np.array([pose(turn(t), place(np.array([t]))[0]) for t in times])
    stamps, step = np.arange(0.0, seconds, 1.0 / RATE), 1e-3
    moved = (place(stamps + step) - 2.0 * place(stamps) + place(np.abs(stamps - step))) / step**2
    moved[0] = moved[1]
    forces = np.array([R_CI.T @ turn(t).T @ (a + GRAVITY * UP) for t, a in zip(stamps, moved, strict=True)])
    forces += 0.05 * np.random.default_rng(1).standard_normal(forces.shape) + (0.0 if bias is None else bias)
    rates = np.array([rotation_log(turn(t).T @ turn(t + step)) / step for t in stamps]) @ R_CI
    rates += 1e-3 * np.random.default_rng(2).standard_normal(rates.shape)
    covariances = np.tile(drift * np.eye(6), (len(times), 1, 1))
    record = SimpleNamespace(
        times=times, poses=poses, covariances=covariances, valid=np.ones(len(times), np.bool_)
    )
    sensor = Imu(R_CI, accel_bias_sd=0.05, mount_sd=1e-3)
    return record, ImuLog(stamps, rates, forces, sensor)


def off(found: Level | None, up: Array = UP) -> float:
    assert found is not None
    return float(np.arccos(np.clip(found.up @ up, -1.0, 1.0)))

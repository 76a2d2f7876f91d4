"""What the sensors of a world's recording say of the worn camera, and the pose that follows from it.

The robot's two scanners see walls, furniture and the person's legs; both cameras carry an AHRS (METHOD 11,
Table C1). Nothing true reaches the estimate but where the person stands at the start, to half a metre.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from collabslam.geometry import pose_inverse, se3_log
from collabslam.types import Array
from collabslam.worn_pose import (
    AhrsReading,
    LaserScan,
    Person,
    WornPoseConfig,
    WornPoseEstimate,
    WornPoseEstimator,
    estimates_at,
)
from collabslam_lab.worlds.recording import WorldRecording
from collabslam_lab.worn_sensors import (
    AhrsModel,
    FloorPlan,
    LaserModel,
    sensor_times,
    simulate_ahrs,
    simulate_scans,
)

LEVEL_SD = 0.005
"""How far the robot's camera is from level on even ground, radians: the floor is flat, driving shakes it."""
AFTER = 0.3
"""Seconds for which they run on after the last one."""


@dataclass(frozen=True)
class Readings:
    """Attributes
    ----------
    scans : list of LaserScan
        Of the front and of the back scanner.
    attitudes : list of AhrsReading
        Of the robot's AHRS and of the worn one.
    """

    scans: list[LaserScan]
    attitudes: list[AhrsReading]


def config_of(recording: WorldRecording, person: Person | None = None) -> WornPoseConfig:
    """What the estimator is told: where the sensors sit, about where the person starts, and, if that was
    measured, how the person is built."""
    _, ahead, left = recording.recipe.stations[0]
    right = -recording.recipe.side * left
    start = (0.5 * round(2.0 * right), 0.5 * round(2.0 * ahead))
    level_sd = float(np.hypot(LEVEL_SD, np.deg2rad(recording.recipe.shake[0])))
    return WornPoseConfig(person=person or Person(), start=start, level_sd=level_sd)


def readings_of(recording: WorldRecording, seed: int) -> Readings:
    """Simulated readings; `seed` is that of their noise."""
    part = 7 if recording.recipe.board is None else 8
    rng = np.random.Generator(np.random.PCG64((seed, recording.recipe.seed, part)))
    config, plan = config_of(recording), FloorPlan(recording.building.plan)
    start, stop = 0.0, float(recording.times[-1]) + AFTER
    robot = recording.robot
    scans: list[LaserScan] = []
    for name, pose in config.scanners.items():
        laser = LaserModel()
        times = sensor_times(start, stop, laser.rate, float(rng.uniform(0.0, 1.0 / laser.rate)))
        scans += simulate_scans(plan, times, robot, pose, recording.shins, rng=rng, scanner=name, model=laser)
    model = AhrsModel()
    times = sensor_times(start, stop, model.rate)
    attitudes = simulate_ahrs(times, robot, config.r_c_ahrs, rng=rng, where="robot", model=model)
    attitudes += simulate_ahrs(times, recording.person, config.r_f_ahrs, rng=rng, where="worn", model=model)
    kept = [replace(s, ranges=s.ranges.astype(np.float32)) for s in scans]  # as a scanner delivers them
    return Readings(kept, attitudes)


def estimated_poses(
    recording: WorldRecording, readings: Readings, person: Person | None = None
) -> list[WornPoseEstimate]:
    """The worn camera's pose at each frame, from the sensors alone."""
    estimator = WornPoseEstimator(config_of(recording, person))
    return estimates_at(recording.times.tolist(), estimator, readings.scans, readings.attitudes)


def pose_errors(recording: WorldRecording, estimates: list[WornPoseEstimate]) -> Array:
    """(N, 6) errors of the estimates on their right tangent, metres and radians; NaN where there is none."""
    out = np.full((len(estimates), 6), np.nan)
    for i, e in enumerate(estimates):
        if e.t_cf is not None:
            out[i] = se3_log(pose_inverse(e.t_cf) @ recording.true_t_cf(i))
    return out

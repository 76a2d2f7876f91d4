"""The worn camera's pose from simulated scans and attitudes, run by run against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from collabslam.evaluation.consistency import nees, pose_tangent_error
from collabslam.geometry import pose_inverse
from collabslam.types import Array
from collabslam.worn_pose import (
    AHEAD_LEFT_UP,
    LaserScan,
    WornPoseConfig,
    WornPoseEstimate,
    WornPoseEstimator,
    estimates_at,
)
from collabslam_lab.paper_simulation.case import Case
from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings
from collabslam_lab.paper_simulation.worn_walks import Walk, random_walk
from collabslam_lab.worn_sensors import sensor_times, simulate_ahrs, simulate_scans

RATE = 10.0
"""Images a second."""
START = 0.5
"""Instant of the first image, seconds."""
_SCANS, _ATTITUDES = 25.0, 100.0


@dataclass(frozen=True)
class WornOutcome:
    """What B runs gave, frame by frame.

    Attributes
    ----------
    error : (B, T, 6) array
        Tangent error, metres and radians; NaN without a pose.
    variance : (B, T, 6) array
        Stated.
    nees_position, nees_rotation, nees : (B, T) array
        3, 3 and 6 degrees of freedom.
    since_seen : (B, T) array
        Seconds since the legs were seen.
    found : (B,) array
        Seconds until the first pose; NaN if there was none.
    """

    error: Array
    variance: Array
    nees_position: Array
    nees_rotation: Array
    nees: Array
    since_seen: Array
    found: Array


def run_worn(s: SimulationSettings, case: Case, seed: int, runs: Sequence[int]) -> WornOutcome:
    """Runs by number; of the settings only ``worn_duration`` and ``worn_told`` count."""
    told = bool(s.worn_told)
    parts = [_run(float(s.worn_duration), told, np.random.default_rng([seed, r])) for r in runs]
    return WornOutcome(*(np.stack(part) for part in zip(*parts, strict=True)))


def _run(duration: float, told: bool, rng: np.random.Generator) -> tuple[Array, ...]:
    walk = random_walk(rng, duration)
    times = sensor_times(START, duration, RATE)
    estimates = walk_estimates(walk, times, duration, told, rng)
    truth = np.array([pose_inverse(walk.robot(float(t))) @ walk.person.camera(float(t)) for t in times])
    nothing, vague = np.full((4, 4), np.nan), np.full((6, 6), np.nan)
    poses = np.array([nothing if e.t_cf is None else e.t_cf for e in estimates])
    p = np.array([vague if e.covariance is None else e.covariance for e in estimates])
    error = pose_tangent_error(poses, truth)
    known = np.flatnonzero(np.isfinite(error[:, 0]))
    return (
        error,
        np.diagonal(p, axis1=1, axis2=2).copy(),
        nees(error[:, :3], p[:, :3, :3]),
        nees(error[:, 3:], p[:, 3:, 3:]),
        nees(error, p),
        np.array([e.diagnostics.since_seen for e in estimates]),
        np.array(times[known[0]] if known.size else np.nan),
    )


def walk_estimates(
    walk: Walk, times: Array, duration: float, told: bool, rng: np.random.Generator
) -> list[WornPoseEstimate]:
    """Simulate the sensors of a walk, lose some scans, and estimate.

    The estimator is told (to 0.2 m) where the person starts, or finds them by itself.
    """
    start = walk.robot(0.0)[:3, :3].T @ (np.append(walk.person.trunk(0.0), 0.0) - walk.robot(0.0)[:3, 3])
    hint = start[[0, 2]] + rng.normal(0.0, 0.2, 2)
    config = WornPoseConfig(start=(float(hint[0]), float(hint[1])) if told else None)
    scans: list[LaserScan] = []
    for name, phase in (("front", 0.003), ("back", 0.021)):
        stamps = sensor_times(0.0, duration, _SCANS, phase)
        pose = config.scanners[name]
        scans += simulate_scans(walk.plan, stamps, walk.robot, pose, walk.legs, rng=rng, scanner=name)
    if rng.random() < 0.4:  # the scanners fall silent
        start = rng.uniform(0.3, 0.9) * duration
        stop = start + rng.uniform(0.4, 1.5)
        scans = [s for s in scans if not start < s.t < stop]
    stamps = sensor_times(0.0, duration, _ATTITUDES)
    readings = simulate_ahrs(stamps, walk.robot, AHEAD_LEFT_UP, rng=rng, where="robot")
    readings += simulate_ahrs(stamps, walk.person.camera, AHEAD_LEFT_UP, rng=rng, where="worn")
    return estimates_at(times, WornPoseEstimator(config), scans, readings)

"""The 2-DoF simulation in the real 6-DoF core: the same runs, held to a plane.

The camera is an equidistant one, so that a constant noise of pixels is a constant noise of angles; all
landmarks are at its height and the vertical pixel is measured without error, so the estimate stays in the
plane. Pseudo-stereo enters as a depth on the ray of Cs. The core starts at rest with a velocity as uncertain
as the mean speed, where the 2-DoF filter is given a noisy velocity.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collabslam._core import Camera
from collabslam.evaluation.consistency import nees
from collabslam.types import Array
from collabslam_lab.paper_simulation.case import Case
from collabslam_lab.paper_simulation.core_run import CoreRun, FilterSettings, SimulatedFrame, common_settings
from collabslam_lab.paper_simulation.estimators import Estimator
from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings
from collabslam_lab.paper_simulation.wall import WallRuns, simulate
from collabslam_lab.paper_simulation.wall_run import RunOutcome

_FOCAL = 400.0
_HEIGHT = 64


def run_wall_core(s: SimulationSettings, case: Case, seed: int, runs: Sequence[int]) -> RunOutcome:
    """As `run_wall`, by the core; the estimator must be one that the core has."""
    data = simulate(s, seed, runs)
    sigma_r = s.range_sigma if case.range_sigma is None else case.range_sigma
    outcomes = [_run(s, case, data, b, sigma_r) for b in range(len(runs))]
    return RunOutcome(*(np.stack(part) for part in zip(*outcomes, strict=True)))


def core_settings(s: SimulationSettings, estimator: Estimator) -> FilterSettings:
    """The filter's settings that express the simulation."""
    return {
        **common_settings(s, estimator, _FOCAL),
        "estimator.mode": "mono",
        "birth.min_baseline": 0.0,
        "birth.max_rho_ratio": 10.0,
        "process.start_angular_velocity_sd": float(np.radians(s.start_turn_sigma)),
        "map.max_features": s.map_size,
        "map.candidate_age": s.duration,
    }


def _run(s: SimulationSettings, case: Case, data: WallRuns, b: int, sigma_r: float) -> tuple[Array, ...]:
    width = int(np.ceil(_FOCAL * np.radians(min(s.fov + 20.0, 175.0))))
    middle = (0.5 * width, 0.5 * _HEIGHT)
    camera = Camera("fisheye", width, _HEIGHT, (_FOCAL, _FOCAL, *middle), (0.0, 0.0, 0.0, 0.0))
    core = CoreRun(camera, core_settings(s, case.estimator), data.landmarks.shape[1])
    poses, tangent = np.zeros((s.frames, 4, 4)), np.zeros((s.frames, 6, 6))
    drift = np.full(s.frames, np.nan)
    points = np.full(data.landmarks.shape[1:], np.nan)
    for k in range(s.frames):
        frame = _frame(s, case.collaboration, data, b, k, sigma_r, middle)
        if k == 0:
            aside = np.where(frame.visible, np.abs(data.true_bearings[b, 0]), np.inf)
            numbers = [int(i) for i in np.argsort(aside)[: s.known_features]]
            at = data.landmarks[b, numbers] + s.known_sigma * data.known_draws[b, numbers]
            core.start_from_points(0.0, np.insert(at, 1, 0.0, axis=1), numbers, s.known_sigma)
            core.look_after(frame)
        else:
            core.step(frame)
        poses[k], tangent[k] = core.filter.pose, core.filter.pose_covariance
        landmarks = core.filter.landmarks()
        which = [core.features[int(i)] for i in landmarks.ids]
        points[which] = landmarks.points[:, [0, 2]]
        use = (landmarks.rho_ratio < s.converged) & frame.visible[which]
        if use.any():
            away = points[which] - poses[k, [0, 2], 3]
            ratio = data.true_ranges[b, k, which] / np.hypot(away[:, 0], away[:, 1])
            drift[k] = abs(1.0 - ratio[use].mean())
    path, rotation = poses[:, [0, 2], 3], poses[:, [0, 2], :3]
    covariance = rotation @ tangent[:, :3, :3] @ np.swapaxes(rotation, 1, 2)
    off = path - data.states[b, :, :2]
    ratio = nees(off, covariance)
    ratio[0] = np.nan
    return np.hypot(off[:, 0], off[:, 1]), ratio, drift, path, covariance, points


def _frame(
    s: SimulationSettings,
    collaboration: str,
    data: WallRuns,
    b: int,
    k: int,
    sigma_r: float,
    middle: tuple[float, float],
) -> SimulatedFrame:
    # The heading grows to the left in the picture.
    bearings = data.bearings[b, k]
    uv = np.stack([middle[0] - _FOCAL * bearings, np.full(len(bearings), middle[1])], axis=1)
    depths = None
    if k > 0 and collaboration != "mono" and s.window_at(k) >= 0:
        ranges, _ = data.stereo(s, k, shared=collaboration == "shared", range_sigma=sigma_r)
        along = np.cos(bearings)
        depths = (np.maximum(ranges[b], 0.1 * s.wall_distance) * along, sigma_r * np.abs(along))
    return SimulatedFrame(k / s.rate, uv, data.visible[b, k], depths=depths)

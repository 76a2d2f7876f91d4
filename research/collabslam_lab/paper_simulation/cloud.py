"""Consistency in 6-DoF: the real core among simulated points, with the noise of the paper's simulation.

A camera travels along a wall of points, turning and swaying in all six degrees of freedom. Its pixels are
as noisy as the paper's bearings (sigma_Cs in each axis), births wait for alpha_min, and in both windows a
worn camera gives its pixels and a pose with the errors of Table C1. Motion and noise are exactly what the
filter assumes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collabslam._core import Camera
from collabslam.evaluation.consistency import nees, pose_tangent_error
from collabslam.geometry import rotation_exp, se3_exp
from collabslam.types import Array
from collabslam_lab.paper_simulation.case import Case
from collabslam_lab.paper_simulation.core_run import CoreRun, SimulatedFrame, common_settings
from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings

WORN_POSITION = (-0.6, -0.3, 0.0)
"""Cf in C, metres."""
WORN_SIGMA = (0.03, 0.03, 0.03, *np.radians([0.5, 1.0, 0.5]))
"""Of its measured pose: metres, then radians about x, y, z of F (Table C1)."""
SIZE = (640, 480)
_START_TURN = 0.1


@dataclass(frozen=True)
class CloudOutcome:
    """What B runs gave, frame by frame, each (B, T).

    Attributes
    ----------
    error, attitude_error : array
        Metres and radians.
    nees_position, nees_attitude : array
        3 degrees of freedom each; NaN in the first frame, whose pose is known.
    nees_pose : array
        6 degrees of freedom.
    """

    error: Array
    attitude_error: Array
    nees_position: Array
    nees_attitude: Array
    nees_pose: Array


def run_cloud(s: SimulationSettings, case: Case, seed: int, runs: Sequence[int]) -> CloudOutcome:
    """Runs by number; ``collaboration`` is ``mono`` or the filter's mode of use of Cf in the windows."""
    outcomes = [_run(s, case, np.random.default_rng([seed, r])) for r in runs]
    return CloudOutcome(*(np.stack(part) for part in zip(*outcomes, strict=True)))


def _run(s: SimulationSettings, case: Case, rng: np.random.Generator) -> tuple[Array, ...]:
    focal = 0.5 * SIZE[0] / np.tan(0.5 * np.radians(s.fov))
    sigma = float(focal * np.radians(s.bearing_sigma))
    camera = Camera("pinhole", *SIZE, (focal, focal, 0.5 * SIZE[0], 0.5 * SIZE[1]))
    points, poses = wall(s, rng), walk(s, rng)
    settings = {
        **common_settings(s, case.estimator, focal),
        "estimator.mode": case.collaboration,
        "birth.max_rho_ratio": 2.0,
        "pixel.sigma_cf": sigma,
        "process.start_angular_velocity_sd": _START_TURN,
        "map.max_features": 5 * s.cloud_in_view,
    }
    core = CoreRun(camera, settings, s.cloud_in_view)
    estimates, covariances = [], []
    for k, pose in enumerate(poses):
        frame = _frame(s, camera, points, pose, k, rng, sigma, case.collaboration)
        if k == 0:
            numbers = [int(p) for p in np.flatnonzero(frame.visible)[: s.cloud_in_view]]
            at = points[numbers] + s.known_sigma * rng.normal(size=(len(numbers), 3))
            core.start_from_points(0.0, at, numbers, s.known_sigma)
            core.look_after(frame)
        else:
            core.step(frame)
        estimates.append(core.filter.pose)
        covariances.append(core.filter.pose_covariance)
    e = pose_tangent_error(np.array(estimates), poses)
    p = np.array(covariances)
    ratios = [nees(e[:, :3], p[:, :3, :3]), nees(e[:, 3:], p[:, 3:, 3:]), nees(e, p)]
    for ratio in ratios:
        ratio[0] = np.nan
    return np.linalg.norm(e[:, :3], axis=1), np.linalg.norm(e[:, 3:], axis=1), *ratios


def wall(s: SimulationSettings, rng: np.random.Generator) -> Array:
    """(N, 3) points on a wall ahead, x along it, y down, metres."""
    along, up = (-8.0, s.path + 8.0), (-s.wall_distance, s.wall_distance)
    count = rng.poisson(s.cloud_density * (along[1] - along[0]) * (up[1] - up[0]))
    depth = s.wall_distance + s.cloud_relief * rng.uniform(-1.0, 1.0, count)
    return np.stack([rng.uniform(*along, count), rng.uniform(*up, count), depth], axis=1)


def walk(s: SimulationSettings, rng: np.random.Generator) -> Array:
    """(T, 4, 4) poses T_WC, the identity first."""
    dt, mean = 1.0 / s.rate, np.array([s.path / s.duration, 0.0, 0.0])
    position, velocity, turn, spin = np.zeros(3), mean.copy(), np.zeros(3), np.zeros(3)
    poses = np.tile(np.eye(4), (s.frames, 1, 1))
    for k in range(1, s.frames):
        kick = rng.normal(size=6) * np.sqrt(dt)
        line = np.array([0.0, position[1], position[2]])
        velocity = velocity + s.acceleration_density * kick[:3]
        velocity -= ((velocity - mean) / s.velocity_time + s.path_stiffness * line) * dt
        spin = spin + np.radians(s.angular_acceleration_density) * kick[3:]
        spin -= (s.heading_damping * spin + s.heading_stiffness * turn) * dt
        position, turn = position + velocity * dt, turn + spin * dt
        poses[k, :3, :3], poses[k, :3, 3] = rotation_exp(turn), position
    return poses


def _frame(
    s: SimulationSettings,
    camera: Camera,
    points: Array,
    pose: Array,
    k: int,
    rng: np.random.Generator,
    sigma: float,
    collaboration: str,
) -> SimulatedFrame:
    """The draws are the same whether Cf is used or not."""
    in_c = (points - pose[:3, 3]) @ pose[:3, :3]
    uv, visible = pixels(camera, in_c, sigma * rng.normal(size=(len(points), 2)))
    noise, error = sigma * rng.normal(size=(len(points), 2)), np.array(WORN_SIGMA) * rng.normal(size=6)
    if collaboration == "mono" or s.window_at(k) < 0:
        return SimulatedFrame(k / s.rate, uv, visible)
    t_cf = np.eye(4)
    t_cf[:3, 3] = WORN_POSITION
    uv_f, visible_f = pixels(camera, in_c - t_cf[:3, 3], noise)
    worn = (t_cf @ se3_exp(-error), np.diag(np.square(WORN_SIGMA)), uv_f, visible & visible_f)
    return SimulatedFrame(k / s.rate, uv, visible, [worn])


def pixels(camera: Camera, in_camera: Array, noise: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Noisy pixels (N, 2), and which points are in front and in the image with and without noise."""
    true = camera.project(in_camera)
    measured, good = true.uv + noise, true.visible
    for pixels in (true.uv, measured):
        good = good & (pixels >= 0.0).all(axis=1) & (pixels <= np.array(SIZE) - 1.0).all(axis=1)
    return np.where(np.isfinite(measured), measured, 0.0), good & (in_camera[:, 2] > 0.0)

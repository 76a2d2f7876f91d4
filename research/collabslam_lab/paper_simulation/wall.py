"""The truth of the 2-DoF simulation (METHOD 14): a camera moves along a wall of landmarks and measures
bearings.

Axes: x along the wall, z towards it; the heading is the angle from x to the optical axis (Eq. 10), 90
degrees when
the camera faces the wall. All arrays have the run first, then the frame, then the landmark.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collabslam.types import Array
from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings

_MARGIN_M = 12.0
"""Of wall before the start and behind the mean end."""


@dataclass(frozen=True)
class WallRuns:
    """Truth and measurements of B runs over T frames and L landmarks.

    Attributes
    ----------
    states : (B, T, 6) array
        x, z (m), heading (rad), and their rates.
    landmarks : (B, L, 2) array
        x, z, metres.
    visible : (B, T, L) bool array
    bearings : (B, T, L) array
        Measured by Cs against the optical axis, rad.
    true_bearings, true_ranges : (B, T, L) array
    stereo_draws : (B, T, L, 2) array
        Unit normals of range and bearing, independent.
    window_draws : (B, 2, 2) array
        The same, one for each window.
    known_draws : (B, L, 2) array
    start_draws : (B, 3) array
    """

    states: Array
    landmarks: Array
    visible: NDArray[np.bool_]
    bearings: Array
    true_bearings: Array
    true_ranges: Array
    stereo_draws: Array
    window_draws: Array
    known_draws: Array
    start_draws: Array

    def stereo(
        self, s: SimulationSettings, frame: int, *, shared: bool, range_sigma: float
    ) -> tuple[Array, Array]:
        """Pseudo-stereo ranges (m) and bearings (rad) of a frame in a window, each (B, L).

        ``shared``: one error for a whole window, instead of one for each landmark and frame.
        """
        window = s.window_at(frame)
        draws = self.window_draws[:, None, window] if shared else self.stereo_draws[:, frame]
        ranges = self.true_ranges[:, frame] + range_sigma * draws[..., 0]
        bearings = self.true_bearings[:, frame] + np.radians(s.stereo_bearing_sigma) * draws[..., 1]
        return ranges, bearings


def simulate(s: SimulationSettings, seed: int, runs: Sequence[int]) -> WallRuns:
    """Runs by number: run ``r`` of a seed is the same whatever runs are made with it, and whatever the
    sigmas are."""
    x = np.arange(-_MARGIN_M, s.path + _MARGIN_M, s.spacing)
    steps, count = s.frames - 1, len(x)
    draws = [np.random.default_rng([seed, r]) for r in runs]
    states = _walk(s, np.stack([g.normal(size=(steps, 3)) for g in draws]))
    depth = np.stack([g.uniform(-1.0, 1.0, count) for g in draws])
    landmarks = np.stack([np.broadcast_to(x, depth.shape), s.wall_distance + s.wall_relief * depth], axis=-1)
    noise = np.stack([g.normal(size=(s.frames, count)) for g in draws])
    away = landmarks[:, None] - states[:, :, None, :2]
    bearings = np.arctan2(away[..., 1], away[..., 0]) - states[:, :, None, 2]
    return WallRuns(
        states=states,
        landmarks=landmarks,
        visible=np.abs(bearings) < 0.5 * np.radians(s.fov),
        bearings=bearings + np.radians(s.bearing_sigma) * noise,
        true_bearings=bearings,
        true_ranges=np.hypot(away[..., 0], away[..., 1]),
        stereo_draws=np.stack([g.normal(size=(s.frames, count, 2)) for g in draws]),
        window_draws=np.stack([g.normal(size=(2, 2)) for g in draws]),
        known_draws=np.stack([g.normal(size=(count, 2)) for g in draws]),
        start_draws=np.stack([g.normal(size=3) for g in draws]),
    )


def _walk(s: SimulationSettings, draws: Array) -> Array:
    """(B, T, 6) states of a walk that returns to its mean velocity, its line and its heading."""
    dt, speed = 1.0 / s.rate, s.path / s.duration
    kicks = draws * np.sqrt(dt)
    kicks[..., :2] *= s.acceleration_density
    kicks[..., 2] *= np.radians(s.angular_acceleration_density)
    states = np.zeros((len(draws), draws.shape[1] + 1, 6))
    states[:, 0] = [0.0, 0.0, 0.5 * np.pi, speed, 0.0, 0.0]
    for k in range(draws.shape[1]):
        position, rate = states[:, k, :3], states[:, k, 3:]
        pull = np.stack(
            [
                -(rate[:, 0] - speed) / s.velocity_time,
                -rate[:, 1] / s.velocity_time - s.path_stiffness * position[:, 1],
                -s.heading_damping * rate[:, 2] - s.heading_stiffness * (position[:, 2] - 0.5 * np.pi),
            ],
            axis=1,
        )
        new = rate + pull * dt + kicks[:, k]
        states[:, k + 1, 3:] = new
        states[:, k + 1, :3] = position + 0.5 * (rate + new) * dt
    return states

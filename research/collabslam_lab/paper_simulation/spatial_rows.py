"""The observability matrix in 6-DoF, numerically (METHOD 13): constant velocity, pixels and 3D points over
time.

The measurements of several frames are differentiated by the initial state with central differences of fourth
order.
With enough frames this holds what Lie derivatives of all orders hold.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from collabslam.geometry import rotation_exp
from collabslam.types import Array

_STEP = 1e-3


def observability_matrix(
    seed: int, *, features: int, frames: int, points: int, parameters: str, quaternion: bool
) -> Array:
    """(rows, columns) derivative of all measurements by the initial state.

    Parameters
    ----------
    seed : int
        Of the random scene.
    features, frames : int
    points : int
        Pseudo-stereo 3D points, all in the first frame.
    parameters : str
        ``euclidean`` (3 a feature) or ``inverse-depth`` (6).
    quaternion : bool
        Attitude as 4 numbers, normalised where it is used, instead of a tangent of 3.
    """
    rng = np.random.default_rng(seed)
    world = np.stack([*rng.uniform(-2.0, 2.0, (2, features)), rng.uniform(3.0, 6.0, features)], axis=1)
    anchors = rng.uniform(-0.5, 0.5, (features, 3))
    rays = world - anchors
    theta = np.arctan2(rays[:, 0], rays[:, 2])
    phi = np.arctan2(-rays[:, 1], np.hypot(rays[:, 0], rays[:, 2]))
    inverse = np.concatenate(
        [anchors, np.stack([theta, phi, 1.0 / np.linalg.norm(rays, axis=1)], axis=1)], axis=1
    )
    attitude = [1.0, 0.0, 0.0, 0.0] if quaternion else [0.0, 0.0, 0.0]
    rates = [*rng.uniform(-0.5, 0.5, 3), *rng.uniform(-0.3, 0.3, 3)]
    chart = world if parameters == "euclidean" else inverse
    state = np.array([*rng.uniform(-0.3, 0.3, 3), *attitude, *rates, *chart.ravel()])

    def measure(x: Array) -> Array:
        return _measure(x, features, frames, points, quaternion)

    return _derivative(measure, state)


def _measure(x: Array, features: int, frames: int, points: int, quaternion: bool) -> Array:
    turn = 7 if quaternion else 6
    start = _rotation(x[3:7]) if quaternion else rotation_exp(x[3:6])
    chart = x[turn + 6 :].reshape(features, -1)
    world = chart
    if chart.shape[1] == 6:
        theta, phi = chart[:, 3], chart[:, 4]
        ray = np.stack([np.cos(phi) * np.sin(theta), -np.sin(phi), np.cos(phi) * np.cos(theta)], axis=1)
        world = chart[:, :3] + ray / chart[:, 5:]
    out = []
    for k in range(frames):
        t = 0.3 * k
        rotation = start @ rotation_exp(x[turn + 3 : turn + 6] * t)
        in_camera = (world - x[:3] - x[turn : turn + 3] * t) @ rotation
        out.append((in_camera[:, :2] / in_camera[:, 2:]).ravel())
        if k == 0:
            out.append(in_camera[:points].ravel())
    return np.concatenate(out)


def _rotation(q: Array) -> Array:
    w, v = q[0], q[1:]
    norm = float(np.linalg.norm(v))
    if norm < 1e-300:
        return np.eye(3)
    return rotation_exp(2.0 * np.arctan2(norm, w) * v / norm)


def _derivative(f: Callable[[Array], Array], x: Array) -> Array:
    columns = []
    for i in range(len(x)):
        step = np.zeros(len(x))
        step[i] = _STEP
        near, far = f(x + step) - f(x - step), f(x + 2.0 * step) - f(x - 2.0 * step)
        columns.append((8.0 * near - far) / (12.0 * _STEP))
    return np.stack(columns, axis=1)

"""What views of Cf tell of T_CF's time-correlated error and of its clock (METHOD 26): ranks, by motion.

The poses of Cs are free, the points too; T_CF is measured without noise but for an error that is always the
same along the axes of Cs, and each view of Cf was taken a little after its frame.  Both cameras see the
directions of all points.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from collabslam.datasets.worn_calibration import corrected
from collabslam.geometry import pose_inverse, rotation_exp, se3_exp, se3_log
from collabslam.types import Array
from collabslam_lab.paper_simulation.rank import numeric_nullity

FRAMES, POINTS, APART = 9, 7, 0.2
"""Frames, landmarks, and seconds between frames."""
_STEP = 1e-4
_POSE = 6
"""Numbers of the pose in the world, which nothing tells."""

Path = Callable[[float], Array]
"""Of a time: a pose (4, 4)."""


def _screw(v: tuple[float, float, float], w: tuple[float, float, float]) -> Path:
    """Constant velocity, m/s and rad/s along its own axes."""

    def at(t: float) -> Array:
        pose, small = np.eye(4), se3_exp(np.array([*v, *w]) * 1e-3)
        for _ in range(round(t * 1e3)):
            pose = pose @ small
        return pose

    return at


def _lively(turns: bool) -> Path:
    def at(t: float) -> Array:
        pose = np.eye(4)
        pose[:3, 3] = [0.5 * np.sin(2.0 * t), 0.3 * np.sin(3.0 * t + 1.0), t + 0.2 * np.sin(4.0 * t)]
        if turns:
            pose[:3, :3] = rotation_exp(0.4 * np.sin(np.array([1.3, 2.1, 1.7]) * t + [0.3, 1.0, 2.0]))
        return pose

    return at


def _fixed(t: float) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = rotation_exp([0.1, -0.2, 0.05])
    pose[:3, 3] = [0.7, -0.4, 0.5]
    return pose


def _walking(t: float) -> Array:
    pose = _fixed(t)
    pose[:3, :3] = pose[:3, :3] @ rotation_exp(0.3 * np.sin(np.array([1.1, 1.9, 2.3]) * t))
    pose[:3, 3] += 0.3 * np.sin(np.array([1.5, 2.2, 1.2]) * t + [0.0, 1.0, 2.0])
    return pose


MOTIONS: dict[str, tuple[Path, Path]] = {
    "Cs and Cf move freely": (_lively(True), _walking),
    "Cs does not turn, Cf walks about": (_lively(False), _walking),
    "Cf fixed to Cs, which moves freely": (_lively(True), _fixed),
    "Cs at constant velocity, Cf walks about": (_screw((0.3, 0.1, 1.0), (0.0, 0.0, 0.0)), _walking),
    "Cs turns evenly about one axis, Cf walks about": (_screw((0.2, 0.0, 1.0), (0.0, 0.4, 0.0)), _walking),
    "Cs at constant velocity, Cf fixed to it": (_screw((0.3, 0.1, 1.0), (0.0, 0.0, 0.0)), _fixed),
    "Cs turns evenly about one axis, Cf fixed to it": (_screw((0.2, 0.0, 1.0), (0.0, 0.4, 0.0)), _fixed),
}
"""How Cs moves in the world, and Cf relative to Cs."""


def untold(motion: tuple[Path, Path], seed: int, *, known_length: bool) -> int:
    """How many of the seven, with the scale, no view tells.

    Parameters
    ----------
    motion : (Path, Path)
        Of `MOTIONS`.
    seed : int
        Of the landmarks.
    known_length : bool
        Whether something else tells the length of Cs's way.
    """
    robot, person = motion
    times = APART * np.arange(FRAMES)
    poses, t_cf = np.array([robot(t) for t in times]), np.array([person(t) for t in times])
    points = np.random.default_rng(seed).uniform([-3.0, -2.0, 4.0], [3.0, 2.0, 9.0], (POINTS, 3))

    def measure(x: Array) -> Array:
        return _measured(x, poses, t_cf, points, known_length)

    count = 6 * FRAMES + 3 * POINTS + 7
    steps = _STEP * np.eye(count)
    columns = [(8.0 * (measure(e) - measure(-e)) - measure(2.0 * e) + measure(-2.0 * e)) for e in steps]
    return numeric_nullity(np.stack(columns, axis=1) / (12.0 * _STEP)) - _POSE


def _measured(x: Array, poses: Array, t_cf: Array, points: Array, known_length: bool) -> Array:
    """All directions, with each unknown moved from the truth by ``x``."""
    moved = np.array([p @ se3_exp(d) for p, d in zip(poses, x[: 6 * FRAMES].reshape(-1, 6), strict=True)])
    there = points + x[6 * FRAMES : -7].reshape(-1, 3)
    out = [_directions(pose, there) for pose in moved]
    for k in range(1, FRAMES - 1):
        way = se3_log(pose_inverse(moved[k - 1]) @ moved[k + 1]) / (2.0 * APART)
        out.append(_directions(moved[k] @ se3_exp(way * x[-1]) @ corrected(t_cf[k], x[-7:-1]), there))
    if known_length:
        out.append(np.linalg.norm(np.diff(moved[:, :3, 3], axis=0), axis=1))
    return np.concatenate(out)


def _directions(pose: Array, points: Array) -> Array:
    inside = (points - pose[:3, 3]) @ pose[:3, :3]
    return np.asarray(inside / np.linalg.norm(inside, axis=1, keepdims=True)).ravel()

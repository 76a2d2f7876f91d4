"""Errors of a trajectory (METHOD section 12; equation numbers are the paper's).

Poses are ``T_WC``, (N, 4, 4), metres; estimate and truth hold the same instants in the same order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from collabslam.errors import InputError
from collabslam.evaluation.alignment import point_pair, umeyama
from collabslam.types import Array


def inverse(poses: ArrayLike) -> Array:
    """Inverses of rigid poses, (..., 4, 4)."""
    t = np.asarray(poses, np.float64)
    out = np.zeros_like(t)
    rotation = np.swapaxes(t[..., :3, :3], -1, -2)
    out[..., :3, :3] = rotation
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", rotation, t[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def first_poses_aligned(truth: ArrayLike, t_start_true: ArrayLike, t_start_estimated: ArrayLike) -> Array:
    """Truth moved into W so that it and the estimate share the start pose (for Eq. 15, 16 and NEES).

    Parameters
    ----------
    truth : (N, 4, 4) array
        In the data set's own world.
    t_start_true, t_start_estimated : (4, 4) arrays
        Both poses at the start.

    Returns
    -------
    (N, 4, 4) array
    """
    moved: Array = np.asarray(t_start_estimated) @ inverse(t_start_true) @ np.asarray(truth, np.float64)
    return moved


def path_length(positions: ArrayLike) -> float:
    """Length of the path through (N, 3) positions, metres."""
    p = np.asarray(positions, np.float64)
    return float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum())


def position_errors(estimate: ArrayLike, truth: ArrayLike) -> Array:
    """Distance ``|r_i - r_hat_i|`` per pose, (N,) metres, of (N, 3) positions; nothing is aligned here."""
    a, b = point_pair(estimate, truth)
    return np.asarray(np.linalg.norm(b - a, axis=1))


def accumulated_position_error(estimate: ArrayLike, truth: ArrayLike) -> float:
    """Eq. 15: sum of the position errors, metres; grows with the number of frames."""
    return float(position_errors(estimate, truth).sum())


def average_position_error(estimate: ArrayLike, truth: ArrayLike) -> float:
    """Eq. 16: mean of the position errors, metres."""
    return float(position_errors(estimate, truth).mean())


def ate_rmse(estimate: ArrayLike, truth: ArrayLike, *, with_scale: bool = False) -> float:
    """Absolute trajectory error: RMS position error, metres, after SE(3) alignment WITHOUT scale.

    ``with_scale`` fits the scale, too (Sim(3)): for comparison with systems that have none; raises InputError
    if the estimate never moves.
    """
    a, b = point_pair(estimate, truth)
    aligned = umeyama(a, b, with_scale=with_scale).apply(a)
    return float(np.sqrt(((aligned - b) ** 2).sum(axis=1).mean()))


def scale_error(estimate: ArrayLike, truth: ArrayLike) -> float:
    """Scale of the Sim(3) alignment onto the truth, minus 1: positive if the estimate is too small."""
    return umeyama(estimate, truth, with_scale=True).scale - 1.0


def rotation_angles(rotations: ArrayLike) -> Array:
    """Angle of each rotation matrix (N, 3, 3), (N,) radians in [0, pi], exact for small angles too."""
    r = np.asarray(rotations, np.float64)
    axis = np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=1)
    return np.asarray(np.arctan2(np.linalg.norm(axis, axis=1), np.trace(r, axis1=1, axis2=2) - 1.0))


def orientation_errors(estimate: ArrayLike, truth: ArrayLike) -> Array:
    """Angle between estimated and true attitude per pose, (N,) radians; poses are (N, 4, 4)."""
    a, b = _pose_pair(estimate, truth)
    return rotation_angles(np.swapaxes(a[:, :3, :3], 1, 2) @ b[:, :3, :3])


def heading_errors(estimate: ArrayLike, truth: ArrayLike) -> Array:
    """Estimated minus true azimuth of the optical axis (theta of METHOD section 2), (N,) radians."""
    a, b = _pose_pair(estimate, truth)
    theta = [np.arctan2(t[:, 0, 2], t[:, 2, 2]) for t in (a, b)]
    return np.asarray((theta[0] - theta[1] + np.pi) % (2.0 * np.pi) - np.pi)


def rpe(estimate: ArrayLike, truth: ArrayLike, *, step: int = 1) -> tuple[float, float]:
    """Relative pose error over ``step`` poses: RMS of translation (metres) and of rotation (radians).

    Parameters
    ----------
    estimate, truth : (N, 4, 4) arrays
        A pair of poses with a NaN in it is left out.
    step : int
        How many poses lie between the two ends of a pair.

    Returns
    -------
    (float, float)
        Both NaN if no pair is left.
    """
    a, b = _pose_pair(estimate, truth)
    if step < 1:
        raise InputError(f"The step is {step}; give 1 or more.")
    moved_a, moved_b = (inverse(t[:-step]) @ t[step:] for t in (a, b))
    error = inverse(moved_b) @ moved_a
    error = error[np.isfinite(error).all(axis=(1, 2))]
    if not len(error):
        return float("nan"), float("nan")
    translation = np.sqrt((error[:, :3, 3] ** 2).sum(axis=1).mean())
    rotation = np.sqrt((rotation_angles(error[:, :3, :3]) ** 2).mean())
    return float(translation), float(rotation)


def _pose_pair(estimate: ArrayLike, truth: ArrayLike) -> tuple[Array, Array]:
    a, b = np.asarray(estimate, np.float64), np.asarray(truth, np.float64)
    if a.shape != b.shape or a.shape[1:] != (4, 4) or not len(a):
        raise InputError(
            f"Poses have the shapes {a.shape} and {b.shape}; give two arrays (N, 4, 4) of one length."
        )
    return a, b

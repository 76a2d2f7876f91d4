"""Rigid-body geometry with the conventions of METHOD section 1.

Poses are 4x4 float64 matrices: ``t_ab`` maps points of frame B into frame A.  The tangent space of a pose
is (translation, rotation) on the right, ``T = T_hat Exp(xi)``, with the two parts acting separately:
``Exp((v, w)) = [R(w), v; 0, 1]``.  Quaternions are Hamilton, unit, scalar first (w, x, y, z).

The formulas are the core's, the same that the filter works with.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from collabslam._core import (
    adjoint,
    fixed_to_tangent,
    interpolate_pose,
    is_rotation,
    left_jacobian,
    pose_inverse,
    quaternion_wxyz,
    rotation_exp,
    rotation_from_quaternion,
    rotation_log,
    se3_exp,
    se3_log,
    skew,
    tangent_to_fixed,
)
from collabslam.errors import InputError
from collabslam.types import Array

__all__ = [
    "adjoint",
    "fixed_to_tangent",
    "interpolate_pose",
    "is_rotation",
    "left_jacobian",
    "nearest_rotation",
    "pose",
    "pose_from_quaternion",
    "pose_inverse",
    "quaternion_wxyz",
    "rotation_exp",
    "rotation_from_quaternion",
    "rotation_log",
    "rounded_covariance",
    "se3_exp",
    "se3_log",
    "skew",
    "tangent_to_fixed",
]


def pose(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """4x4 pose of a rotation matrix (3, 3) and a translation (3,), metres.

    Raises
    ------
    InputError
        For a wrong shape, or a number that is not finite.
    """
    turn, shift = np.asarray(rotation, np.float64), np.asarray(translation, np.float64)
    if turn.shape != (3, 3) or shift.shape != (3,):
        raise InputError(f"A pose of shapes {turn.shape} and {shift.shape}; give (3, 3) and (3,).")
    if not (np.isfinite(turn).all() and np.isfinite(shift).all()):
        raise InputError("The pose holds values that are not finite; give finite numbers.")
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn, shift
    return out


def pose_from_quaternion(t: ArrayLike, q_wxyz: ArrayLike) -> Array:
    """4x4 pose of a translation (3,), metres, and a Hamilton quaternion (4,), scalar first."""
    return pose(rotation_from_quaternion(q_wxyz), t)


def nearest_rotation(matrix: ArrayLike) -> Array:
    """The rotation (3, 3) nearest to a matrix (3, 3), by least squares (Kabsch)."""
    u, _, vt = np.linalg.svd(np.asarray(matrix, dtype=np.float64))
    sign = 1.0 if np.linalg.det(u) * np.linalg.det(vt) > 0.0 else -1.0
    return np.asarray((u * np.array([1.0, 1.0, sign])) @ vt, dtype=np.float64)


def rounded_covariance(covariance: ArrayLike) -> Array:
    """A covariance rounded to 2^-40 (1e-12) of about its largest variance.

    One that was rounded has the same bits again after a file has stated it along other axes.
    """
    c = np.asarray(covariance, dtype=np.float64)
    largest = float(np.max(np.diag(c)))
    if not largest > 0.0:
        return np.array(c)
    step = 2.0 ** (np.floor(np.log2(largest * (1.0 + 1e-9))) - 40.0)
    return np.asarray(np.round(c / step) * step, dtype=np.float64)

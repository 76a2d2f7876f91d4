"""Rigid-body geometry with the conventions of METHOD section 1.

Poses are 4x4 float64 matrices: ``t_ab`` maps points of frame B into frame A.  The tangent space of a pose
is (translation, rotation) on the right, ``T = T_hat Exp(xi)``, with the two parts acting separately:
``Exp((v, w)) = [R(w), v; 0, 1]``.  Quaternions are Hamilton, unit, scalar first (w, x, y, z).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from collabslam.errors import InputError
from collabslam.types import Array

_SMALL_ANGLE = 1e-8


def _shaped(value: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    array: Array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise InputError(f"{what} has the shape {array.shape}; give an array of the shape {shape}.")
    if not bool(np.all(np.isfinite(array))):
        raise InputError(f"{what} holds values that are not finite; give finite numbers.")
    return array


def skew(v: ArrayLike) -> Array:
    """Matrix of the cross product: ``skew(v) @ p == cross(v, p)``.

    Parameters
    ----------
    v : (3,) array

    Returns
    -------
    (3, 3) array
    """
    x, y, z = _shaped(v, (3,), "The vector")
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_exp(w: ArrayLike) -> Array:
    """Rotation matrix of a rotation vector (radians), by Rodrigues' formula.

    Parameters
    ----------
    w : (3,) array
        Axis times angle, radians.

    Returns
    -------
    (3, 3) array
    """
    vector = _shaped(w, (3,), "The rotation vector")
    angle = float(np.linalg.norm(vector))
    k = skew(vector)
    if angle < _SMALL_ANGLE:
        return np.eye(3) + k + 0.5 * (k @ k)
    # 1 - cos(a) = 2 sin(a / 2)^2 keeps its digits at small angles.
    second = 0.5 * (np.sin(0.5 * angle) / (0.5 * angle)) ** 2
    return np.asarray(np.eye(3) + (np.sin(angle) / angle) * k + second * (k @ k), dtype=np.float64)


def rotation_log(rotation: ArrayLike) -> Array:
    """Rotation vector (radians) of a rotation matrix; its norm is at most pi.

    Parameters
    ----------
    rotation : (3, 3) array

    Returns
    -------
    (3,) array
    """
    q = quaternion_wxyz(rotation)
    norm = float(np.linalg.norm(q[1:]))
    if norm < _SMALL_ANGLE:
        return np.asarray(2.0 * q[1:], dtype=np.float64)
    return np.asarray((2.0 * np.arctan2(norm, q[0]) / norm) * q[1:], dtype=np.float64)


def rotation_from_quaternion(q_wxyz: ArrayLike) -> Array:
    """Rotation matrix of a Hamilton quaternion, scalar first; the quaternion is normalised.

    Parameters
    ----------
    q_wxyz : (4,) array

    Returns
    -------
    (3, 3) array

    Raises
    ------
    InputError
        If the quaternion's norm is zero.
    """
    q = _shaped(q_wxyz, (4,), "The quaternion")
    norm = float(np.linalg.norm(q))
    if norm < 1e-12:
        raise InputError("The quaternion is zero; give a unit quaternion (w, x, y, z).")
    w, x, y, z = q / norm
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def quaternion_wxyz(rotation: ArrayLike) -> Array:
    """Unit Hamilton quaternion (w, x, y, z) with w >= 0 of a rotation matrix.

    Parameters
    ----------
    rotation : (3, 3) array

    Returns
    -------
    (4,) array
    """
    m = _shaped(rotation, (3, 3), "The rotation matrix")
    # Four times the products of the quaternion's parts; the row of the largest one is the best conditioned.
    k = np.array(
        [
            [
                1.0 + m[0, 0] + m[1, 1] + m[2, 2],
                m[2, 1] - m[1, 2],
                m[0, 2] - m[2, 0],
                m[1, 0] - m[0, 1],
            ],
            [0.0, 1.0 + m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [0.0, 0.0, 1.0 - m[0, 0] + m[1, 1] - m[2, 2], m[1, 2] + m[2, 1]],
            [0.0, 0.0, 0.0, 1.0 - m[0, 0] - m[1, 1] + m[2, 2]],
        ]
    )
    k = np.triu(k) + np.triu(k, 1).T
    q = k[int(np.argmax(np.diag(k)))]
    q = q / np.linalg.norm(q)
    return np.asarray(-q if q[0] < 0.0 else q, dtype=np.float64)


def pose(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """4x4 pose of a rotation matrix (3, 3) and a translation (3,), metres."""
    out = np.eye(4)
    out[:3, :3] = _shaped(rotation, (3, 3), "The rotation matrix")
    out[:3, 3] = _shaped(translation, (3,), "The translation")
    return out


def pose_from_quaternion(t: ArrayLike, q_wxyz: ArrayLike) -> Array:
    """4x4 pose of a translation (3,), metres, and a Hamilton quaternion (4,), scalar first."""
    return pose(rotation_from_quaternion(q_wxyz), t)


def pose_inverse(t_ab: ArrayLike) -> Array:
    """Inverse of a rigid pose: ``t_ba`` of ``t_ab``, both (4, 4)."""
    t = _shaped(t_ab, (4, 4), "The pose")
    out = np.eye(4)
    out[:3, :3] = t[:3, :3].T
    out[:3, 3] = -t[:3, :3].T @ t[:3, 3]
    return out


def se3_exp(xi: ArrayLike) -> Array:
    """Exp of METHOD section 1: ``Exp((v, w)) = [R(w), v; 0, 1]``.

    Translation and rotation act separately: ``T_hat Exp(xi) = (R_hat R(w), t_hat + R_hat v)``.

    Parameters
    ----------
    xi : (6,) array
        Translation in metres, then rotation vector in radians.

    Returns
    -------
    (4, 4) array
    """
    x = _shaped(xi, (6,), "The tangent vector")
    return pose(rotation_exp(x[3:]), x[:3])


def se3_log(t: ArrayLike) -> Array:
    """Inverse of :func:`se3_exp`: (6,) translation in metres, then rotation vector in radians."""
    matrix = _shaped(t, (4, 4), "The pose")
    return np.concatenate([matrix[:3, 3], rotation_log(matrix[:3, :3])])


def adjoint(t_ab: ArrayLike) -> Array:
    """Matrix that carries a small tangent vector through a pose, in (translation, rotation) order.

    To first order ``T Exp(xi) T^-1 = Exp(adjoint(T) xi)``; it turns a right perturbation into a left one.

    Parameters
    ----------
    t_ab : (4, 4) array

    Returns
    -------
    (6, 6) array
    """
    t = _shaped(t_ab, (4, 4), "The pose")
    out = np.zeros((6, 6))
    out[:3, :3] = t[:3, :3]
    out[3:, 3:] = t[:3, :3]
    out[:3, 3:] = skew(t[:3, 3]) @ t[:3, :3]
    return out


def tangent_to_fixed(t_ab: ArrayLike, covariance: ArrayLike) -> Array:
    """A pose's covariance along the fixed axes of A: diag(R, R) P diag(R, R)^T.

    Parameters
    ----------
    t_ab : (4, 4) array
    covariance : (6, 6) array
        Over (translation, rotation), tangent on the right.

    Returns
    -------
    (6, 6) array
        Over (x, y, z, rotation about X, Y, Z) of A, as in ROS's PoseWithCovariance.
    """
    turn = np.kron(np.eye(2), _shaped(t_ab, (4, 4), "The pose")[:3, :3])
    return np.asarray(turn @ _shaped(covariance, (6, 6), "The covariance") @ turn.T)


def fixed_to_tangent(t_ab: ArrayLike, covariance: ArrayLike) -> Array:
    """The inverse of `tangent_to_fixed`."""
    turn = np.asarray(t_ab, dtype=np.float64).copy()
    turn[:3, :3] = turn[:3, :3].T
    return tangent_to_fixed(turn, covariance)


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


def interpolate_pose(t0: ArrayLike, t1: ArrayLike, share: float) -> Array:
    """Pose between two poses: straight in translation, constant rate in rotation.

    Parameters
    ----------
    t0, t1 : (4, 4) arrays
    share : float
        0 gives ``t0``, 1 gives ``t1``.

    Returns
    -------
    (4, 4) array
    """
    a = _shaped(t0, (4, 4), "The first pose")
    b = _shaped(t1, (4, 4), "The second pose")
    step = rotation_log(a[:3, :3].T @ b[:3, :3])
    return pose(a[:3, :3] @ rotation_exp(share * step), (1.0 - share) * a[:3, 3] + share * b[:3, 3])


def is_rotation(matrix: Any, tolerance: float = 1e-3) -> bool:
    """Whether a (3, 3) matrix is orthonormal with determinant +1 within ``tolerance``."""
    m = np.asarray(matrix, dtype=np.float64)
    if m.shape != (3, 3) or not bool(np.all(np.isfinite(m))):
        return False
    return bool(np.max(np.abs(m @ m.T - np.eye(3))) < tolerance and np.linalg.det(m) > 0.0)

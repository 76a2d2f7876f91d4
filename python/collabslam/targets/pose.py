"""The camera's pose from points of known place, with its covariance (METHOD section 10)."""

from __future__ import annotations

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.errors import InputError
from collabslam.geometry import pose_inverse, se3_exp
from collabslam.types import Array

_STEP = 1e-6  # of the numeric derivatives, metres and radians
_ITERATIONS = 50


def pose_from_points(
    points: Array, uv: Array, camera: Camera, sigma_px: float, guess: Array | None = None
) -> tuple[Array, Array]:
    """Camera pose from known points and their pixels (PnP), with its covariance.

    Parameters
    ----------
    points : (N, 3) float64
        Points in the target's frame, metres; at least four.
    uv : (N, 2) float64
        Their pixels.
    camera : Camera
    sigma_px : float
        Standard deviation of a pixel coordinate.
    guess : (4, 4) float64, optional
        Approximate pose, camera to target; found without iteration (SQPnP) unless given.

    Returns
    -------
    t_tc : (4, 4) float64
        Maps points of C into the target's frame.
    covariance : (6, 6) float64
        ``s^2 (J^T J)^-1`` over (translation, rotation), tangent on the right; s is ``sigma_px``, or the
        residuals' own size where that is larger.

    Raises
    ------
    InputError
        If there are fewer than four points, or they leave the pose open (for instance all on one line).
    """
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    uv = np.asarray(uv, dtype=np.float64).reshape(-1, 2)
    if len(points) != len(uv) or len(points) < 4:
        raise InputError(
            f"A pose needs at least four points with a pixel each; got {len(points)} and {len(uv)}."
        )
    pose = np.asarray(guess, dtype=np.float64) if guess is not None else _first_pose(points, uv, camera)
    damping = 1e-6
    cost, gradient, hessian = _normal_equations(points, uv, camera, pose)
    for _ in range(_ITERATIONS):
        damped = hessian + damping * np.diag(np.diag(hessian) + 1e-12)
        try:
            step = -np.linalg.solve(damped, gradient)
        except np.linalg.LinAlgError:
            break
        trial = pose @ se3_exp(step) if np.all(np.isfinite(step)) else pose
        new_cost, new_gradient, new_hessian = _normal_equations(points, uv, camera, trial)
        if not new_cost < cost:
            damping *= 10.0
            if damping > 1e8 or np.abs(step).max() < 1e-10:
                break
            continue
        small = cost - new_cost < 1e-12 * (1.0 + cost)
        pose, cost, gradient, hessian = trial, new_cost, new_gradient, new_hessian
        damping = max(damping / 10.0, 1e-12)
        if small:
            break
    if not np.isfinite(cost) or np.linalg.cond(hessian) > 1e14:
        raise InputError(
            "The points leave the camera's pose open; give at least four that are not on one line."
        )
    freedom = 2 * len(points) - 6
    variance = max(sigma_px**2, cost / freedom)
    covariance = variance * np.linalg.inv(hessian)
    return pose, 0.5 * (covariance + covariance.T)


def _first_pose(points: Array, uv: Array, camera: Camera) -> Array:
    """Pose by SQPnP on the undistorted pixels."""
    rays = camera.unproject(uv)
    flat = rays[:, :2] / np.maximum(rays[:, 2:], 1e-6)
    try:
        found, turn, shift = cv2.solvePnP(points, flat, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_SQPNP)
    except cv2.error:
        found = False
    if not found:
        raise InputError("No camera pose explains the points; give an approximate one.")
    t_ct = np.eye(4)
    t_ct[:3, :3] = cv2.Rodrigues(turn)[0]
    t_ct[:3, 3] = shift.ravel()
    return pose_inverse(t_ct)


def project_points(points: Array, camera: Camera, t_tc: Array) -> tuple[Array, Array]:
    """Pixels (N, 2) of a target's points, and their derivative (N, 2, 6) by an error of the pose."""
    poses = [t_tc] + [t_tc @ se3_exp(_STEP * axis) for axis in np.eye(6)]
    seen = np.stack([(points - pose[:3, 3]) @ pose[:3, :3] for pose in poses])
    front = seen[..., 2] > 1e-6
    uv = camera.project(np.where(front[..., None], seen, [0.0, 0.0, 1.0]).reshape(-1, 3)).uv
    uv = np.where(front[..., None], uv.reshape(7, len(points), 2), np.nan)
    return uv[0], ((uv[1:] - uv[0]) / _STEP).transpose(1, 2, 0)


def _normal_equations(points: Array, uv: Array, camera: Camera, pose: Array) -> tuple[float, Array, Array]:
    """Sum of squared residuals (infinite where a point is not seen), its half gradient and J^T J."""
    projected, jacobian = project_points(points, camera, pose)
    residual = projected - uv
    if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(jacobian))):
        return np.inf, np.zeros(6), np.eye(6)
    rows = jacobian.reshape(-1, 6)
    return float((residual**2).sum()), rows.T @ residual.ravel(), rows.T @ rows

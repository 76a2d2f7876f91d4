"""Start from a known metric target: the camera's pose from points of known place (METHOD section 10).

:func:`find_target` locates the patches of a :class:`~collabslam.types.Target`; :func:`checkerboard_points`
and :func:`marker_points` find printed targets; :func:`pose_from_points` turns any 3D-2D list into a pose with
its covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.errors import DataError, InputError
from collabslam.frontend.search import FOUND, peak_test, search_around, search_window
from collabslam.geometry import pose_inverse, se3_exp
from collabslam.settings.frontend import SearchSettings
from collabslam.types import Array, Image, Indices, Target

RADIUS = 10.0
"""Least radius in which a patch of the target is searched, pixels."""
SIGMA = 0.5
"""Standard deviation of a located point, pixels."""
_MIN_SCORE = 0.7  # least correlation of a patch of the target
_MAX_RESIDUAL = 3.0  # pixels, largest distance of a point from its place under the pose found
_STEP = 1e-6  # of the numeric derivatives, metres and radians
_ITERATIONS = 50


@dataclass(frozen=True)
class TargetFix:
    """Outcome of :func:`find_target`.

    Attributes
    ----------
    uv : (K, 2) float64
        Sub-pixel positions of the points found.
    index : (K,) int64
        Their rows in the target.
    t_tc : (4, 4) float64
        Camera pose: maps points of C into the target's frame, metres.
    covariance : (6, 6) float64
        Of ``t_tc`` over (translation, rotation), tangent on the right, m^2 and rad^2.
    """

    uv: Array
    index: Indices
    t_tc: Array
    covariance: Array


def find_target(
    image: Image, camera: Camera, target: Target, settings: SearchSettings | None = None
) -> TargetFix:
    """Locate a target's patches around their predicted pixels, and the camera's pose from them.

    Parameters
    ----------
    image : (H, W) uint8
    camera : Camera
    target : Target
        Points, patches and the approximate pose; the search covers three standard deviations of its
        covariance, and at least :data:`RADIUS`.
    settings : SearchSettings, optional

    Returns
    -------
    TargetFix

    Raises
    ------
    DataError
        If fewer than four of the points are found where one pose can explain them.
    """
    settings = settings or SearchSettings()
    points = np.asarray(target.points, dtype=np.float64).reshape(-1, 3)
    if len(target.patches) != len(points):
        raise DataError(
            f"The target has {len(points)} points but {len(target.patches)} patches; give one for each."
        )
    predicted, jacobian = _project(points, camera, np.asarray(target.t_tc, dtype=np.float64))
    spread = jacobian @ np.asarray(target.covariance, dtype=np.float64) @ jacobian.transpose(0, 2, 1)
    window = search_window(settings.max_radius, min_radius=RADIUS, large_radius=settings.max_radius)
    peaks = peak_test(_MIN_SCORE)
    uv = np.full((len(points), 2), np.nan)
    for k, patch in enumerate(target.patches):
        side = min(patch.shape) - (1 - min(patch.shape) % 2)
        template = np.ascontiguousarray(patch[:side, :side])[None]
        found = search_around(image, template, predicted[k : k + 1], spread[k : k + 1], window, peaks)
        if found.code[0] == FOUND:
            # The patch's middle is its point; an even side leaves half a pixel.
            uv[k] = found.uv[0] + (np.array(patch.shape[::-1]) - side) / 2.0
    index = np.flatnonzero(np.isfinite(uv[:, 0]))
    while len(index) >= 4:
        t_tc, covariance = pose_from_points(points[index], uv[index], camera, SIGMA, target.t_tc)
        residual = np.linalg.norm(_project(points[index], camera, t_tc)[0] - uv[index], axis=1)
        if residual.max() <= _MAX_RESIDUAL:
            return TargetFix(uv[index], index, t_tc, covariance)
        index = np.delete(index, int(np.argmax(residual)))
    raise DataError(
        f"Fewer than four of the target's {len(points)} points were found; check its patches and its "
        "start pose."
    )


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


def _project(points: Array, camera: Camera, t_tc: Array) -> tuple[Array, Array]:
    """Pixels (N, 2) of a target's points, and their derivative (N, 2, 6) by an error of the pose."""
    poses = [t_tc] + [t_tc @ se3_exp(_STEP * axis) for axis in np.eye(6)]
    seen = np.stack([(points - pose[:3, 3]) @ pose[:3, :3] for pose in poses])
    front = seen[..., 2] > 1e-6
    uv = camera.project(np.where(front[..., None], seen, [0.0, 0.0, 1.0]).reshape(-1, 3)).uv
    uv = np.where(front[..., None], uv.reshape(7, len(points), 2), np.nan)
    return uv[0], ((uv[1:] - uv[0]) / _STEP).transpose(1, 2, 0)


def _normal_equations(points: Array, uv: Array, camera: Camera, pose: Array) -> tuple[float, Array, Array]:
    """Sum of squared residuals (infinite where a point is not seen), its half gradient and J^T J."""
    projected, jacobian = _project(points, camera, pose)
    residual = projected - uv
    if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(jacobian))):
        return np.inf, np.zeros(6), np.eye(6)
    rows = jacobian.reshape(-1, 6)
    return float((residual**2).sum()), rows.T @ residual.ravel(), rows.T @ rows


def checkerboard_points(image: Image, columns: int, rows: int, square: float) -> tuple[Array, Array]:
    """Inner corners of a checkerboard.

    Parameters
    ----------
    image : (H, W) uint8
    columns, rows : int
        Number of inner corners along and across; one odd and one even make the board's direction unambiguous.
    square : float
        Side of a square, metres.

    Returns
    -------
    points : (N, 3) float64
        Corners in the board's frame (x along, y across, z = 0), metres.
    uv : (N, 2) float64
        Their pixels.

    Raises
    ------
    DataError
        If the board is not seen whole.
    """
    found, corners = cv2.findChessboardCornersSB(image, (columns, rows))
    if not found:
        raise DataError(
            f"No checkerboard of {columns} x {rows} inner corners is seen whole; check the numbers."
        )
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    points = square * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(np.float64)
    return points, np.asarray(corners, dtype=np.float64).reshape(-1, 2)


def marker_points(image: Image, dictionary: str, sides: dict[int, float]) -> dict[int, tuple[Array, Array]]:
    """Corners of ArUco or AprilTag markers.

    Parameters
    ----------
    image : (H, W) uint8
    dictionary : str
        OpenCV's name of the set, such as ``DICT_4X4_50`` or ``DICT_APRILTAG_36h11``.
    sides : dict
        Side of each marker that is looked for, metres, by its number.

    Returns
    -------
    dict
        For each marker seen: its corners (4, 3) in its own frame (centre 0, x right, y down, z into the
        paper, metres), and their pixels (4, 2).

    Raises
    ------
    InputError
        If OpenCV knows no such set.
    """
    if not dictionary.startswith("DICT_") or not hasattr(cv2.aruco, dictionary):
        raise InputError(f"OpenCV has no marker set '{dictionary}'; give a name such as DICT_APRILTAG_36h11.")
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    corners, numbers, _ = cv2.aruco.ArucoDetector(markers, parameters).detectMarkers(image)
    square = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
    seen = {}
    for pixels, number in zip(corners, np.ravel(numbers) if numbers is not None else [], strict=True):
        if int(number) in sides:
            seen[int(number)] = (
                sides[int(number)] * square,
                np.asarray(pixels, dtype=np.float64).reshape(4, 2),
            )
    return seen

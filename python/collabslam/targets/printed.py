"""Printed tags and boards in an image, found by OpenCV, and where the camera is relative to each.

A small or distant target that is seen nearly from the front has two poses that explain its corners about
equally well.  Where both do, the covariance reaches from one to the other; where they are too far apart for
that, the target is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.errors import DataError, InputError
from collabslam.geometry import adjoint, pose_inverse, se3_log
from collabslam.targets.kinds import FAMILIES, Board, Tag
from collabslam.targets.pose import pose_from_points, project_points
from collabslam.types import Array, Image

SIGMA = 0.3
"""Standard deviation of a tag's corner, pixels; of a board's, which has many, the scatter tells it."""
_BOARD_SIGMA = 0.15
_COMMON = 0.1  # pixels by which all corners of a target may be shifted together
AMBIGUOUS = 9.0
"""Of the chi square by which the better of two poses has to win."""
_SAME = 1e-3  # radians and metres: from either guess the iteration has come to the same pose
_MAX_TILT = 0.35  # radians between two poses that one covariance can hold
_MAX_RESIDUAL = 3.0  # pixels of a corner from its place: more is another calibration, or no such target


@dataclass(frozen=True)
class Sighting:
    """A known target in an image, and where the camera is.

    Attributes
    ----------
    target : Tag, Board or None
        None for the points of a `Target`.
    points : (N, 3) float64
        Its corners in its own frame, metres.
    uv : (N, 2) float64
        Their pixels.
    t_tc : (4, 4) float64
        Maps points of the camera into the target's frame.
    covariance : (6, 6) float64
        Of ``t_tc`` over (translation, rotation), tangent on the right, m^2 and rad^2.
    """

    target: Tag | Board | None
    points: Array
    uv: Array
    t_tc: Array
    covariance: Array


def printed_corners(image: Image, targets: Iterable[Tag | Board]) -> dict[Tag | Board, Array]:
    """Corners (N, 2), px, of those of some printed targets that an image shows.

    Parameters
    ----------
    image : (H, W) uint8
    targets : iterable of Tag and Board
        A tag that is seen twice in an image is left out: one of both is a copy.
    """
    targets = tuple(targets)
    corners: dict[Tag | Board, Array] = {}
    for family in sorted({t.family for t in targets if isinstance(t, Tag)}):
        seen = marker_corners(image, family)
        of_family = [t for t in targets if isinstance(t, Tag) and t.family == family]
        corners |= {t: seen[t.number] for t in of_family if t.number in seen}
    for board in (t for t in targets if isinstance(t, Board)):
        found = board_corners(image, board)
        if found is not None:
            corners[board] = found
    return corners


def sightings(image: Image, camera: Camera, targets: Iterable[Tag | Board]) -> list[Sighting]:
    """The printed targets that an image shows well enough to tell the camera's pose."""
    corners = printed_corners(image, targets)
    seen = (sighting(target, uv, camera) for target, uv in corners.items())
    return [s for s in seen if s is not None]


def sighting(target: Tag | Board, uv: Array, camera: Camera) -> Sighting | None:
    """The camera's pose from a printed target's corners (N, 2), px; None where they do not tell it."""
    solutions = planar_solutions(target, uv, camera)
    if not solutions:
        return None
    least, pose, covariance = solutions[0]
    for chi2, other, _ in solutions[1:]:
        if chi2 - least < AMBIGUOUS:
            apart = se3_log(pose_inverse(pose) @ other)
            if float(np.linalg.norm(apart[3:])) > _MAX_TILT:
                return None
            covariance = covariance + np.outer(apart, apart)
    return Sighting(target, target.corners(), uv, pose, covariance)


def planar_solutions(target: Tag | Board, uv: Array, camera: Camera) -> list[tuple[float, Array, Array]]:
    """The poses, two at most, that explain a printed target's corners (N, 2), px, the better one first.

    Returns
    -------
    list of (chi2, T_TC, covariance)
        The chi square of the corners, of residuals as large as they are, T_TC (4, 4), metres, and its
        covariance (6, 6), tangent on the right; none where no pose explains them.
    """
    points = target.corners()
    sigma = SIGMA if isinstance(target, Tag) else _BOARD_SIGMA
    solutions = []
    for guess in _planar_poses(points, uv, camera):
        try:
            pose, covariance = pose_from_points(points, uv, camera, sigma, guess)
        except InputError:
            continue
        error = np.linalg.norm(project_points(points, camera, pose)[0] - uv, axis=1)
        if error.max() <= _MAX_RESIDUAL:
            covariance = covariance + _of_common_shift(points, camera, pose)
            solutions.append((float((error**2).sum()) / sigma**2, pose, covariance))
    solutions.sort(key=lambda s: s[0])
    # Where even the better one is worse than the noise, all of it is that much larger.
    larger = max(1.0, solutions[0][0] / (2 * len(points) - 6)) if solutions else 1.0
    return [
        (chi2 / larger, pose, covariance)
        for k, (chi2, pose, covariance) in enumerate(solutions)
        if k == 0 or np.linalg.norm(se3_log(pose_inverse(solutions[0][1]) @ pose)) > _SAME
    ]


def _of_common_shift(points: Array, camera: Camera, pose: Array) -> Array:
    """Covariance (6, 6) of the pose by an error that all corners have in common, as blur gives it."""
    jacobian = project_points(points, camera, pose)[1]
    rows = jacobian.reshape(-1, 6)
    by_shift = np.linalg.solve(rows.T @ rows, jacobian.sum(axis=0).T)
    return np.asarray(_COMMON**2 * by_shift @ by_shift.T)


def _planar_poses(points: Array, uv: Array, camera: Camera) -> list[Array]:
    """Both poses, camera to target, that the homography of a plane allows."""
    rays = camera.unproject(uv)
    flat = rays[:, :2] / np.maximum(rays[:, 2:], 1e-6)
    try:
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            points, flat, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:
        return []
    poses = []
    for turn, shift in zip(turns, shifts, strict=True):
        t_ct = np.eye(4)
        t_ct[:3, :3] = cv2.Rodrigues(turn)[0]
        t_ct[:3, 3] = np.ravel(shift)
        if np.isfinite(t_ct).all():
            poses.append(pose_inverse(t_ct))
    return poses


@lru_cache(maxsize=16)
def _detector(family: str) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[family]))
    return cv2.aruco.ArucoDetector(markers, parameters)


def marker_corners(image: Image, family: str) -> dict[int, Array]:
    """Corners (4, 2), px, of each tag of a family that an image shows once, by its number."""
    corners, numbers, _ = _detector(family).detectMarkers(image)
    numbers = [] if numbers is None else np.ravel(numbers).tolist()
    once = {n for n in numbers if numbers.count(n) == 1}
    pairs = zip(numbers, corners, strict=True)
    return {n: np.asarray(uv, dtype=np.float64).reshape(4, 2) for n, uv in pairs if n in once}


def board_corners(image: Image, board: Board) -> Array | None:
    """Inner corners (N, 2), px, of a checkerboard, row by row; None where it is not seen whole."""
    found, corners = cv2.findChessboardCornersSB(image, (board.columns, board.rows))
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2) if found else None


def any_board(image: Image) -> tuple[int, int] | None:
    """Columns and rows of inner corners of whatever checkerboard an image shows; None if it shows none."""
    found, _, marks = cv2.findChessboardCornersSBWithMeta(image, (3, 3), cv2.CALIB_CB_LARGER)
    return (marks.shape[1], marks.shape[0]) if found else None


def pose_between(
    image: Image,
    camera: Camera,
    worn_image: Image,
    worn_camera: Camera,
    targets: Sequence[Tag | Board],
) -> tuple[Array, Array]:
    """``T_CF`` from printed targets in both pictures: from the one that tells it best.

    Parameters
    ----------
    image, worn_image : (H, W) uint8
        Of Cs and of Cf, taken at the same time.
    camera, worn_camera : Camera
    targets : sequence of Tag and Board
        Boards with one odd and one even number of corners.

    Returns
    -------
    t_cf : (4, 4) float64
        Maps points of F into C, metres.
    covariance : (6, 6) float64
        Over (translation, rotation), tangent on the right; m^2 and rad^2.

    Raises
    ------
    DataError
        If there is none that both cameras see.
    InputError
        If a board begins at either end.
    """
    for board in (t for t in targets if isinstance(t, Board)):
        board.check_direction()
    found = pose_beside(sightings(image, camera, targets), worn_image, worn_camera)
    if found is None:
        raise DataError("No printed target is seen by both cameras; show it to both.")
    return found


def pose_beside(
    of_cs: Sequence[Sighting], worn_image: Image, worn_camera: Camera
) -> tuple[Array, Array] | None:
    """As `pose_between`, of what Cs sees already; None if Cf sees nothing of it."""
    known = {s.target: s for s in of_cs if s.target is not None}
    of_cf = sightings(worn_image, worn_camera, known)
    poses = [between(known[s.target], s) for s in of_cf if s.target is not None]
    return min(poses, key=lambda pose: float(np.linalg.slogdet(pose[1])[1]), default=None)


def between(of_cs: Sighting, of_cf: Sighting) -> tuple[Array, Array]:
    """``T_CF`` and its covariance, as of `pose_between`, from one target's sightings by both cameras."""
    t_cf = pose_inverse(of_cs.t_tc) @ of_cf.t_tc
    carry = adjoint(pose_inverse(t_cf))
    return t_cf, of_cf.covariance + carry @ of_cs.covariance @ carry.T

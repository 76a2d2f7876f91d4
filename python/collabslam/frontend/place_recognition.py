"""Where the camera is in a map, from one image and nothing else: descriptors, PnP, a check by the patches.

Corners of the image are described at some scales and compared with the stored views of all landmarks.  A pose
by RANSAC (P3P) says where every landmark should be; there their patches, warped to that pose, are searched.
Patches found vouch for the pose, and give the matches that the filter takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from collabslam._core import Camera
from collabslam.errors import InputError
from collabslam.frontend.describe import SUPPORT, Descriptors, describe
from collabslam.frontend.detect import Hidden, corner_peaks, refine_corners
from collabslam.frontend.map_views import MapViews
from collabslam.frontend.patch import SIZE, Patch, warp_templates
from collabslam.frontend.search import FOUND, GATE, active_search
from collabslam.geometry import pose_inverse
from collabslam.settings.frontend import FrontendSettings
from collabslam.targets.pose import pose_from_points
from collabslam.types import Array, Image, Indices

KIND = "warped-sift"
"""Descriptor of views and corners: SIFT's histogram at a known scale; it needs no key points of its own."""
SCALES = (0.63, 1.0, 1.6)
"""Sizes at which the image's corners are described, over that of the views."""
MIN_PATCHES = 8
"""Fewest patches found for a pose to be accepted."""
MIN_VOTES = 6
"""Landmarks whose descriptors must look alike for a place to be looked at more closely."""
_MIN_SHARE = 0.3  # and their least share of those that should be visible from it
_MIN_SPREAD = (
    0.02  # least area of the outline of the patches found, of the image's; points close together fix no pose
)
_CORNERS = 500  # most corners of an image in which the camera is looked for
_CORNER_DISTANCE = 0.006  # least distance between them, as a share of the image's width
RATIO = 0.9
"""Of the best to the second best descriptor distance; generous, as patches are searched afterwards."""
MAX_DISTANCE = 0.8
"""Largest distance of two descriptors (unit vectors)."""
_GUESS_RADIUS = 0.08  # of the image's width, around where a landmark is expected, that is tried first
_MIN_DESCRIPTORS = 5  # fewest that must agree on a pose
_CORNER_RESIDUAL = 6.0  # pixels, largest distance of a corner from where the pose puts the landmark
_MAX_RESIDUAL = 4.0  # pixels, the same of a patch found
_RADIUS = 10.0  # pixels, of the patches' search around where the pose puts the landmarks
_ITERATIONS = 300  # most samples of RANSAC
_CONFIDENCE = 0.9999  # of RANSAC, that it has seen a sample without a wrong match


class Fix(NamedTuple):
    """A pose in the map, and what it rests on.

    Attributes
    ----------
    pose : (4, 4) float64
        T_WC.
    landmarks : (N,) int64
        Landmarks found, by their place in the list.
    uv : (N, 2) float64
        Their pixels.
    """

    pose: Array
    landmarks: Indices
    uv: Array


def describe_views(patches: Sequence[Patch], support: float) -> Descriptors:
    """Descriptors (V, D) of stored windows, upright; ``support`` is the side of what is described, pixels."""
    described = [np.empty((0, 128), dtype=np.float32)]
    for patch in patches:
        middle = (len(patch.pixels) - 1) / 2.0
        local = patch.uv_ref - np.rint(patch.uv_ref) + middle
        described.append(describe(patch.pixels, local[None], 0.0, support, KIND))
    return np.concatenate(described)


def describe_corners(image: Image, uv: Array, roll: float, support: float) -> Descriptors:
    """Descriptors (S, C, D) of corners at each of :data:`SCALES`, turned by ``roll`` radians."""
    found = []
    for scale in SCALES:
        small = image
        if scale > 1.0:
            factor = 1.0 / scale
            resized = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
            small = np.asarray(resized, dtype=np.uint8)
        shrink = min(1.0, 1.0 / scale)
        # Pixel centres: the middle of the first pixel lies half a pixel from the image's edge.
        points = (uv + 0.5) * shrink - 0.5
        found.append(describe(small, points, roll, support * scale * shrink, KIND))
    return np.stack(found)


def match_descriptors(
    views: Descriptors,
    owner: Indices,
    corners: Descriptors,
    ratio: float,
    max_distance: float,
    near: NDArray[np.bool_] | None = None,
) -> tuple[Indices, Indices]:
    """Landmarks and corners that are each other's best, and clearly better than the next landmark.

    Parameters
    ----------
    views : (V, D) float32
        Descriptors of the landmarks' views.
    owner : (V,) int64
        Landmark of each, increasing, each number from 0 on at least once.
    corners : (S, C, D) float32
    ratio, max_distance : float
        Largest ratio of the best to the second best distance; largest distance.
    near : (C, L) bool, optional
        Which corners may be which landmark; any may if left out.

    Returns
    -------
    landmark, corner : (M,) int64
        The most distinct first.
    """
    nothing = np.empty(0, dtype=np.int64)
    if len(views) == 0 or corners.shape[1] == 0 or owner[-1] < 1:
        return nothing, nothing
    first = np.flatnonzero(np.r_[True, owner[1:] != owner[:-1]])
    similarity = np.full((corners.shape[1], len(first)), -np.inf, dtype=np.float32)
    for at_scale in corners:
        by_view = at_scale @ views.T
        np.maximum(similarity, np.maximum.reduceat(by_view, first, axis=1), out=similarity)
    if near is not None:
        similarity[~near] = -np.inf
    best = similarity.argmax(axis=1)
    rows = np.arange(len(best))
    top = np.partition(similarity, similarity.shape[1] - 2, axis=1)
    distance, second = (np.sqrt(np.maximum(2.0 - 2.0 * top[:, k], 1e-12)) for k in (-1, -2))
    mutual = similarity.argmax(axis=0)[best] == rows
    good = np.flatnonzero(mutual & (distance < ratio * second) & (distance < max_distance))
    good = good[np.argsort(distance[good] / second[good], kind="stable")]
    return best[good].astype(np.int64), good.astype(np.int64)


def votes(similarity: NDArray[np.float32]) -> int:
    """How many of two sets of descriptors (unit vectors) are each other's nearest, and near.

    Parameters
    ----------
    similarity : (N, M) float32
        Products of the descriptors of both sets.
    """
    if not similarity.size:
        return 0
    best = similarity.argmax(axis=1)
    rows = np.arange(len(best))
    mutual = similarity.argmax(axis=0)[best] == rows
    near = similarity[rows, best] > 1.0 - 0.5 * MAX_DISTANCE**2
    return int((mutual & near).sum())


class ImageCorners:
    """The strongest corners of an image, dense enough that those of all landmarks may be among them.

    They and their descriptors are worked out when they are first asked for, and once, however many maps the
    image is compared with.

    Parameters
    ----------
    image : (H, W) uint8
    settings : FrontendSettings
    hidden : callable, optional
        Which pixels of the image show what is not a landmark.
    """

    def __init__(self, image: Image, settings: FrontendSettings, hidden: Hidden | None = None) -> None:
        self.image, self.settings, self.hidden = image, settings, hidden
        self._described: dict[float, Descriptors] = {}

    @cached_property
    def uv(self) -> Array:
        """(C, 2), pixels."""
        distance = max(2.0, _CORNER_DISTANCE * self.image.shape[1])
        peaks = corner_peaks(self.image, self.settings.detect, distance, SIZE, False)
        if self.hidden is not None:
            peaks = peaks[~self.hidden(peaks)]
        return refine_corners(self.image, peaks[:_CORNERS].astype(np.float64))

    def described(self, roll: float) -> Descriptors:
        """(S, C, D) as `describe_corners` has them, turned by ``roll`` radians."""
        if roll not in self._described:
            self._described[roll] = describe_corners(self.image, self.uv, roll, SUPPORT)
        return self._described[roll]


def most_alike(corners: ImageCorners, places: Sequence[Descriptors]) -> list[int]:
    """Which places look like an image, by the number of votes, the most alike first; upright only.

    Parameters
    ----------
    corners : ImageCorners
    places : sequence of (V, D) float32
        Descriptors of the views of each (`describe_views`).
    """
    if not len(corners.uv):
        return []
    described = corners.described(0.0)
    count = [votes((described @ place.T).max(axis=0)) for place in places]
    likely = [k for k, votes_of_it in enumerate(count) if votes_of_it >= MIN_VOTES]
    return sorted(likely, key=lambda k: (-count[k], k))


def pose_by_ransac(
    points: Array, uv: Array, camera: Camera, tolerance: float, iterations: int
) -> tuple[Array, Indices] | None:
    """A pose T_WC that some of the matches agree on, and those; None if fewer than four do.

    Repeatable: OpenCV's generator starts from the same seed in each call.
    """
    rays = camera.unproject(uv)
    front = np.flatnonzero(np.isfinite(rays).all(axis=1) & (rays[:, 2] > 0.1))
    if len(front) < 4:
        return None
    flat = np.ascontiguousarray(rays[front, :2] / rays[front, 2:])
    try:
        found, turn, shift, inliers = cv2.solvePnPRansac(
            np.ascontiguousarray(points[front]),
            flat,
            np.eye(3),
            np.zeros(4),
            iterationsCount=iterations,
            reprojectionError=tolerance / camera.intrinsics[0],
            confidence=_CONFIDENCE,
            flags=cv2.SOLVEPNP_P3P,
        )
    except cv2.error:
        return None
    if not found or inliers is None or len(inliers) < 4:
        return None
    t_cw = np.eye(4)
    t_cw[:3, :3] = cv2.Rodrigues(turn)[0]
    t_cw[:3, 3] = shift.ravel()
    if not np.isfinite(t_cw).all():
        return None
    return pose_inverse(t_cw), front[inliers.ravel()]


def locate(
    corners: ImageCorners,
    camera: Camera,
    views: MapViews,
    descriptors: Descriptors,
    guess: Array,
    rolls: Sequence[float],
) -> Fix | None:
    """The pose from which an image shows a map; None where that cannot be told with confidence.

    It is looked for near the guess, where few corners can be mistaken for a landmark, and then anywhere.

    Parameters
    ----------
    corners : ImageCorners
        Of the image.
    camera : Camera
    views : MapViews
    descriptors : (V, D) float32
        Of the views (`describe_views`).
    guess : (4, 4) float64
        T_WC as it is expected.
    rolls : sequence of float
        By how much the camera may be turned about its axis against the views, radians, tried in this order; a
        quarter of a radian more or less does no harm.
    """
    uv = corners.uv
    if len(uv) < _MIN_DESCRIPTORS:
        return None
    for roll in rolls:
        described = corners.described(roll)
        places = (_near(camera, uv, views.points, guess, _GUESS_RADIUS), None) if roll == 0.0 else (None,)
        for near in places:
            landmark, corner = match_descriptors(
                descriptors, views.owner, described, RATIO, MAX_DISTANCE, near
            )
            first = pose_by_ransac(views.points[landmark], uv[corner], camera, _CORNER_RESIDUAL, _ITERATIONS)
            if first is None or len(first[1]) < _MIN_DESCRIPTORS:
                continue
            fix = confirmed(corners.image, camera, first[0], views, corners.settings, corners.hidden)
            if fix is not None:
                return fix
    return None


def _near(camera: Camera, corners: Array, points: Array, pose: Array, radius: float) -> NDArray[np.bool_]:
    """(C, L) whether a corner lies where a pose puts a landmark, within a share of the image's width."""
    seen = np.ascontiguousarray((points - pose[:3, 3]) @ pose[:3, :3])
    there = camera.project(seen)
    uv = np.where((there.visible & (seen[:, 2] > 0.0))[:, None], there.uv, np.inf)
    distance = np.linalg.norm(corners[:, None] - uv, axis=2)
    return np.asarray(distance < radius * camera.width)


def confirmed(
    image: Image,
    camera: Camera,
    pose: Array,
    views: MapViews,
    settings: FrontendSettings,
    hidden: Hidden | None = None,
) -> Fix | None:
    """A pose that the landmarks' patches vouch for; None where too few of them are found."""
    for _ in range(2):  # the second search starts from the pose of the first
        index, uv, possible = _search_from(image, camera, pose, views, settings, hidden)
        agreed = pose_of_agreeing(views.points[index], uv, camera, pose, _MAX_RESIDUAL)
        if agreed is None or len(agreed[1]) < max(MIN_PATCHES, _MIN_SHARE * possible):
            return None
        pose, kept = agreed
        index, uv = index[kept], uv[kept]
    hull = cv2.convexHull(uv.astype(np.float32))
    if cv2.contourArea(hull) < _MIN_SPREAD * camera.width * camera.height:
        return None
    return Fix(pose, index, uv)


def _search_from(
    image: Image,
    camera: Camera,
    pose: Array,
    views: MapViews,
    settings: FrontendSettings,
    hidden: Hidden | None,
) -> tuple[Indices, Array, int]:
    """Searches all patches where a pose says: landmarks found, their pixels, and how many could be found."""
    points = views.points
    seen = np.ascontiguousarray((points - pose[:3, 3]) @ pose[:3, :3])
    there = camera.project(seen)
    uv, visible = there.uv, there.visible & (seen[:, 2] > 0.0)
    if hidden is not None:
        visible[visible] = ~hidden(uv[visible])
    nearest = views.nearest(pose)
    index = np.flatnonzero(visible)
    warped = warp_templates(camera, [nearest[i] for i in index], pose, points[index], settings.patch)
    index, templates = index[warped.ok], warped.templates[warped.ok]
    spread = (_RADIUS / GATE) ** 2 * np.eye(2)
    result = active_search(
        image, templates, uv[index], np.broadcast_to(spread, (len(index), 2, 2)), None, settings.search
    )
    hit = result.code == FOUND
    if hidden is not None:
        hit[hit] = ~hidden(result.uv[hit])
    return index[hit], result.uv[hit], len(index)


def pose_of_agreeing(
    points: Array, uv: Array, camera: Camera, pose: Array, tolerance: float
) -> tuple[Array, Indices] | None:
    """The pose of least squares, and the matches that agree with it.

    All that are off by more than the tolerance and by at least half of what the worst one is off by are left
    out at once, and the pose is worked out again: so the rounds are few whatever the number of wrong matches.
    """
    kept = np.arange(len(points))
    while len(kept) >= 4:
        try:
            pose, _ = pose_from_points(points[kept], uv[kept], camera, 1.0, pose)
        except InputError:
            return None
        seen = np.ascontiguousarray((points[kept] - pose[:3, 3]) @ pose[:3, :3])
        residual = np.linalg.norm(camera.project(seen).uv - uv[kept], axis=1)
        agree = residual <= max(tolerance, 0.5 * float(residual.max()))
        if agree.all():
            return pose, kept
        kept = kept[agree]
    return None

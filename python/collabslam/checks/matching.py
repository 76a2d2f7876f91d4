"""Matches between two images by SIFT, and how far they are from a pose's epipolar lines."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from collabslam._core import Camera
from collabslam.checks.mistakes import MirroredCamera
from collabslam.frontend.epipolar import inverse_ranges
from collabslam.geometry import pose_inverse, skew
from collabslam.types import Array, Image

RATIO = 0.7
LEAST_MATCHES = 20
"""Fewer matches say nothing of a pair of images."""
BEHIND = 0.5
"""A pose of which a smaller share of the points lies in front of both cameras is wrong."""
FITS_PX = 3.0
"""Distance from its epipolar line of a match that fits a pose, px."""
_TELLING = 0.25
"""Share of the matches that must tell where they lie."""
_PARALLAX = np.sin(np.deg2rad(0.5))
_FEATURES = 600
_KEPT = 256
"""Images whose points are known still, at 0.3 MB each: every part of a check asks for much the same ones."""
_described: OrderedDict[tuple[tuple[int, ...], bytes], Points] = OrderedDict()


class Points(NamedTuple):
    """Points of an image, (N, 2) px, and their descriptors, (N, 128) float32."""

    uv: Array
    described: NDArray[np.float32]


class Matches(NamedTuple):
    """``uv_a`` and ``uv_b``, both (N, 2) px: the same points in two images."""

    uv_a: Array
    uv_b: Array

    @property
    def swapped(self) -> Matches:
        """The same with the images exchanged."""
        return Matches(self.uv_b, self.uv_a)


def describe(image: Image) -> Points:
    """The points of an image that may be found again, read-only."""
    key = image.shape, hashlib.blake2b(np.ascontiguousarray(image).data).digest()
    if key not in _described:
        _described[key] = _points(image)
        if len(_described) > _KEPT:
            _described.popitem(last=False)
    _described.move_to_end(key)
    return _described[key]


def _points(image: Image) -> Points:
    points, described = cv2.SIFT.create(nfeatures=_FEATURES).detectAndCompute(image, None)
    if described is None:
        return Points(np.empty((0, 2)), np.empty((0, 128), np.float32))
    found = Points(
        np.array([p.pt for p in points], np.float64).reshape(-1, 2), np.asarray(described, np.float32)
    )
    for array in found:
        array.flags.writeable = False
    return found


def match_points(a: Points, b: Points) -> Matches:
    """Points of ``a`` found in ``b``, by the ratio test in both directions."""
    if min(len(a.uv), len(b.uv)) < 2:
        return Matches(np.empty((0, 2)), np.empty((0, 2)))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    there = _distinct(matcher.knnMatch(a.described, b.described, k=2))
    back = _distinct(matcher.knnMatch(b.described, a.described, k=2))
    pairs = [(i, j) for i, j in there.items() if back.get(j) == i]
    first, second = ([pair[side] for pair in pairs] for side in (0, 1))
    return Matches(a.uv[first].reshape(-1, 2), b.uv[second].reshape(-1, 2))


def epipolar_residuals(
    matches: Matches, camera_a: MirroredCamera | Camera, camera_b: MirroredCamera | Camera, t_ab: Array
) -> Array:
    """Sampson distance of each match under a pose, pixels of image a; matches without a ray are left out.

    Parameters
    ----------
    matches : Matches
    camera_a, camera_b : MirroredCamera or Camera
    t_ab : (4, 4) array
        Maps points of camera b into camera a.
    """
    models = [c if isinstance(c, MirroredCamera) else MirroredCamera(c) for c in (camera_a, camera_b)]
    a, b = models[0].rays(matches.uv_a), models[1].rays(matches.uv_b)
    usable = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    return models[0].focal * np.abs(sampson(a[usable], b[usable], t_ab))


def in_front(
    matches: Matches, camera_a: MirroredCamera | Camera, camera_b: MirroredCamera | Camera, t_ab: Array
) -> Array:
    """1 for each match that lies in front of both cameras, 0 for one behind; NaN where nothing tells it.

    Epipolar lines are the same for a pose that points backwards; depth is not.  It is told by matches that
    the pose fits, whose rays are far from parallel.
    """
    models = [c if isinstance(c, MirroredCamera) else MirroredCamera(c) for c in (camera_a, camera_b)]
    a, b = models[0].rays(matches.uv_a), models[1].rays(matches.uv_b)
    fits = models[0].focal * np.abs(sampson(a, b, t_ab)) < FITS_PX
    a, b = (rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (a, b))
    clear = np.linalg.norm(np.cross(a, b @ t_ab[:3, :3].T), axis=1) > _PARALLAX
    ahead = (inverse_ranges(a, b, t_ab) > 0.0) & (inverse_ranges(b, a, pose_inverse(t_ab)) > 0.0)
    return np.where(fits & clear, ahead, np.nan)


def share_in_front(found: Sequence[Array]) -> float:
    """Share of what `in_front` found in several pairs of images; 1 where too few matches tell it."""
    every = np.concatenate(found) if found else np.empty(0)
    known = every[np.isfinite(every)]
    enough = len(known) >= max(LEAST_MATCHES, _TELLING * len(every))
    return float(np.mean(known)) if enough else 1.0


def sampson(a: Array, b: Array, t_ab: Array) -> Array:
    """Signed Sampson distance of rays with z = 1, (N, 3) both, in units of the focal length: (N,)."""
    essential = skew(t_ab[:3, 3]) @ t_ab[:3, :3]
    line_a, line_b = b @ essential.T, a @ essential
    slope = line_a[:, 0] ** 2 + line_a[:, 1] ** 2 + line_b[:, 0] ** 2 + line_b[:, 1] ** 2
    return np.asarray(np.sum(a * line_a, axis=1) / np.sqrt(np.maximum(slope, 1e-30)))


def _distinct(candidates: object) -> dict[int, int]:
    return {
        pair[0].queryIdx: pair[0].trainIdx
        for pair in candidates  # type: ignore[attr-defined]
        if len(pair) == 2 and pair[0].distance < RATIO * pair[1].distance
    }

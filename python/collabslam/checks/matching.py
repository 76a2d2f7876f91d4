"""Matches between two images by SIFT, and how far they are from a pose's epipolar lines."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.geometry import skew
from collabslam.types import Array, Image

RATIO = 0.7
LEAST_MATCHES = 20
"""Fewer matches say nothing of a pair of images."""
_FEATURES = 600


class Matches(NamedTuple):
    """``uv_a`` and ``uv_b``, both (N, 2) px: the same points in two images."""

    uv_a: Array
    uv_b: Array


def match_images(a: Image, b: Image) -> Matches:
    """Points of ``a`` found in ``b``, by the ratio test in both directions."""
    sift = cv2.SIFT.create(nfeatures=_FEATURES)
    points_a, described_a = sift.detectAndCompute(a, None)
    points_b, described_b = sift.detectAndCompute(b, None)
    if described_a is None or described_b is None or min(len(points_a), len(points_b)) < 2:
        return Matches(np.empty((0, 2)), np.empty((0, 2)))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    there = _distinct(matcher.knnMatch(described_a, described_b, k=2))
    back = _distinct(matcher.knnMatch(described_b, described_a, k=2))
    pairs = [(i, j) for i, j in there.items() if back.get(j) == i]
    uv_a = np.array([points_a[i].pt for i, _ in pairs], np.float64).reshape(-1, 2)
    uv_b = np.array([points_b[j].pt for _, j in pairs], np.float64).reshape(-1, 2)
    return Matches(uv_a, uv_b)


def epipolar_residuals(
    matches: Matches, camera_a: Camera, camera_b: Camera, t_ab: Array, focal: float = 1.0
) -> Array:
    """Sampson distance of each match under a pose, pixels; matches without a ray are left out.

    Parameters
    ----------
    matches : Matches
    camera_a, camera_b : Camera
    t_ab : (4, 4) array
        Maps points of camera b into camera a.
    focal : float
        Factor on the focal lengths, for trials.
    """
    rays_a, rays_b = camera_a.unproject(matches.uv_a), camera_b.unproject(matches.uv_b)
    usable = np.isfinite(rays_a).all(axis=1) & np.isfinite(rays_b).all(axis=1)
    usable &= (rays_a[:, 2] > 0.0) & (rays_b[:, 2] > 0.0)
    scale = np.array([1.0 / focal, 1.0 / focal, 1.0])
    a, b = (rays[usable] / rays[usable, 2:] * scale for rays in (rays_a, rays_b))
    essential = skew(t_ab[:3, 3]) @ t_ab[:3, :3]
    line_a, line_b = b @ essential.T, a @ essential
    slope = line_a[:, 0] ** 2 + line_a[:, 1] ** 2 + line_b[:, 0] ** 2 + line_b[:, 1] ** 2
    pixels = focal * float(np.sqrt(camera_a.intrinsics[0] * camera_a.intrinsics[1]))
    return np.asarray(pixels * np.abs(np.sum(a * line_a, axis=1)) / np.sqrt(np.maximum(slope, 1e-30)))


def _distinct(candidates: object) -> dict[int, int]:
    return {
        pair[0].queryIdx: pair[0].trainIdx
        for pair in candidates  # type: ignore[attr-defined]
        if len(pair) == 2 and pair[0].distance < RATIO * pair[1].distance
    }

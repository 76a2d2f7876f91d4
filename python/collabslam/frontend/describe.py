"""Descriptors at given points, all of them unit vectors that are compared by their Euclidean distance.

``warped-sift`` is SIFT's histogram of gradients (4 x 4 cells, 8 directions) over a window that is first
warped as the other view sees it: the relative pose of the two cameras is known well enough to undo rotation,
scale and foreshortening, so neither a scale space nor a dominant direction has to be found.  ``sift`` and
``orb`` are OpenCV's, with the rotation given and one scale.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from collabslam import _core
from collabslam.errors import InputError
from collabslam.types import Array, Image

Descriptors = NDArray[np.float32]
Describe = Callable[[Image, Array, Array, float], Descriptors]

SUPPORT = 36.0
"""Side of the window that the descriptor of a corner covers, pixels."""
_SIFT_SUPPORT = 6.0  # side of OpenCV's SIFT window over KeyPoint.size
_ORB_PATCH = 31


def describe(
    image: Image,
    uv: Array,
    angle_rad: float | Array,
    size_px: float,
    kind: str = "sift",
) -> Descriptors:
    """Descriptors at points whose rotation and scale are known.

    Parameters
    ----------
    image : (H, W) uint8
    uv : (N, 2) float64
    angle_rad : float or (N,) float64
        Direction of the descriptor's first axis, from the image's u axis towards its v axis.
    size_px : float
        Side of the described window, pixels.
    kind : str
        A key of :data:`DESCRIPTORS`.

    Returns
    -------
    (N, D) float32
        Unit vectors; D is 128 for ``sift`` and ``warped-sift``, 256 for ``orb``.

    Raises
    ------
    InputError
        If the kind is unknown.
    """
    if kind not in DESCRIPTORS:
        raise InputError(f"There is no descriptor '{kind}'; choose one of {', '.join(DESCRIPTORS)}.")
    points = np.asarray(uv, dtype=np.float64).reshape(-1, 2)
    angle = np.broadcast_to(np.asarray(angle_rad, dtype=np.float64), (len(points),))
    cosine, sine = np.cos(angle), np.sin(angle)
    axes = np.stack([np.stack([cosine, -sine], axis=1), np.stack([sine, cosine], axis=1)], axis=1)
    return DESCRIPTORS[kind](image, points, axes, size_px)


def describe_warped(image: Image, uv: Array, axes: Array, size_px: float) -> Descriptors:
    """SIFT's histogram over windows warped by an affine map.

    Parameters
    ----------
    image : (H, W) uint8
    uv : (N, 2) float64
    axes : (N, 2, 2) float64
        Maps offsets in the described window to pixel offsets in the image.
    size_px : float
        Side of the window, in pixels of the described (warped) view.

    Returns
    -------
    (N, 128) float32
        Square roots of the L1-normalised histogram (RootSIFT): unit vectors.
    """
    step = size_px / _core.DESCRIPTOR_SAMPLES
    if step < 1.5:
        return _core.describe_windows(image, uv, axes, step)
    half = np.asarray(cv2.pyrDown(image), dtype=np.uint8)
    return _core.describe_windows(half, 0.5 * uv, 0.5 * axes, step)


def crop_around(image: Image, uv: Array, margin: float) -> tuple[Image, Array]:
    """Bounding box of the points with a margin (a crop costs less than a mask), and the points in it."""
    low = np.maximum(np.floor(uv.min(axis=0) - margin), 0).astype(int)
    high = np.minimum(np.ceil(uv.max(axis=0) + margin) + 1, image.shape[::-1]).astype(int)
    return np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]]), uv - low


def angle_and_scale(axes: Array) -> tuple[Array, Array]:
    """Rotation (radians) and scale of affine maps."""
    angle = np.arctan2(axes[:, 1, 0] - axes[:, 0, 1], axes[:, 0, 0] + axes[:, 1, 1])
    return angle, np.sqrt(np.abs(np.linalg.det(axes)))


def _describe_sift(image: Image, uv: Array, axes: Array, size_px: float) -> Descriptors:
    """OpenCV's SIFT; one octave only (its number is packed into the key point), whatever the scale."""
    if len(uv) == 0:
        return np.empty((0, 128), dtype=np.float32)
    angle, scale = angle_and_scale(axes)
    crop, points = crop_around(image, uv, size_px * float(scale.max()))
    first_layer = 1 << 8
    keys = [
        cv2.KeyPoint(
            float(u),
            float(v),
            float(s) * size_px / _SIFT_SUPPORT,
            float(np.degrees(a)) % 360.0,
            1.0,
            first_layer,
        )
        for (u, v), a, s in zip(points, angle, scale, strict=True)
    ]
    _, found = cv2.SIFT.create().compute(crop, keys)
    return np.asarray(np.sqrt(found / (found.sum(axis=1, keepdims=True) + 1e-9)), dtype=np.float32)


def _describe_orb(image: Image, uv: Array, axes: Array, size_px: float) -> Descriptors:
    """OpenCV's ORB as vectors of +-1/16: their squared distance is the Hamming distance over 64."""
    if len(uv) == 0:
        return np.empty((0, 256), dtype=np.float32)
    angle, _ = angle_and_scale(axes)
    crop, points = crop_around(image, uv, size_px)
    padded = cv2.copyMakeBorder(crop, _ORB_PATCH, _ORB_PATCH, _ORB_PATCH, _ORB_PATCH, cv2.BORDER_REPLICATE)
    keys = [
        cv2.KeyPoint(
            float(u) + _ORB_PATCH,
            float(v) + _ORB_PATCH,
            float(_ORB_PATCH),
            float(np.degrees(a)) % 360.0,
            1.0,
            0,
            i,
        )
        for i, ((u, v), a) in enumerate(zip(points, angle, strict=True))
    ]
    _, found = cv2.ORB.create(nlevels=1, edgeThreshold=_ORB_PATCH // 2 + 1).compute(padded, keys)
    bits = np.unpackbits(np.asarray(found, dtype=np.uint8), axis=1).astype(np.float32)
    return np.asarray((2.0 * bits - 1.0) / 16.0, dtype=np.float32)


DESCRIPTORS: dict[str, Describe] = {
    "warped-sift": describe_warped,
    "sift": _describe_sift,
    "orb": _describe_orb,
}

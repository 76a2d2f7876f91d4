"""Corners spread over an image (Shi-Tomasi response, emptiest cells first)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import cv2
import numpy as np

from collabslam import _core
from collabslam.settings.frontend import DetectSettings
from collabslam.types import Array, Image, Mask

Hidden = Callable[[Array], Mask]
"""Which pixels (N, 2) show what is not a landmark."""


def hidden_by_any(hiding: Sequence[Hidden | None]) -> Hidden | None:
    """What at least one of them hides; None of none."""
    some = [hides for hides in hiding if hides is not None]
    if len(some) < 2:
        return some[0] if some else None
    return lambda uv: np.logical_or.reduce([hides(uv) for hides in some])


_HALF_RES_WIDTH = 400  # pixels of width from which corners are looked for at half resolution
_SUBPIXEL_REACH = 2.0  # pixels a corner may move when it is refined
_BLOCK = 5  # pixels, side of the window in which gradients are collected
_MIN_GRADIENT = 2.0
"""Least root-mean-square gradient along a corner's weaker direction, grey levels per pixel, at the resolution
at which corners are looked for; keeps noise out of flat images."""
_GREY_GRADIENT = 255.0 / 2.0  # of OpenCV's 3x3 Sobel: it sees twice the gradient of an image in 0..1


def halves(width: int) -> bool:
    """Whether images of this width are large enough for corners and flow at half resolution."""
    return width >= _HALF_RES_WIDTH


def corner_peaks(image: Image, settings: DetectSettings, distance: float, border: int, halve: bool) -> Array:
    """Local maxima of the Shi-Tomasi response, the strongest first.

    The response is the smaller eigenvalue of the mean gradient matrix.

    Parameters
    ----------
    image : (H, W) uint8
    settings : DetectSettings
    distance : float
        A peak is the largest response within this many pixels (square neighbourhood).
    border : int
        Pixels along the image's edge without peaks.
    halve : bool
        Whether to look at half resolution: a quarter of the cost, and less noise.

    Returns
    -------
    (M, 2) float64
    """
    factor = 2 if halve else 1
    # Means of 2 x 2 pixels: sharper than a pyramid's level.
    small = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) if halve else image
    height, width = small.shape
    border = -(-border // factor)
    if min(height, width) <= 2 * border + 2:
        return np.empty((0, 2))
    reach = max(1, int(distance / factor))
    block = _BLOCK if factor == 1 else max(3, _BLOCK // 2 | 1)
    response = np.asarray(cv2.cornerMinEigenVal(small, block, ksize=3), dtype=np.float32)
    min_response = (_MIN_GRADIENT / _GREY_GRADIENT) ** 2
    peaks = _core.corner_peaks(response, reach, border, settings.quality, min_response)
    return factor * peaks + 0.5 * (factor - 1)


def refine_corners(image: Image, uv: Array) -> Array:
    """Sub-pixel position of corners; one that would move by more than two pixels stays where it was.

    Parameters
    ----------
    image : (H, W) uint8
    uv : (N, 2) float64

    Returns
    -------
    (N, 2) float64
    """
    if len(uv) == 0:
        return uv
    points = np.ascontiguousarray(uv, dtype=np.float32).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 8, 0.02)
    moved = cv2.cornerSubPix(image, points.copy(), (3, 3), (-1, -1), stop)
    near = np.abs(moved - points).max(axis=(1, 2)) <= _SUBPIXEL_REACH
    return np.where(near[:, None], moved[:, 0], points[:, 0]).astype(np.float64)


class Corners:
    """Corners of one image, picked more than once: the response is worked out when it is first needed.

    Parameters
    ----------
    image : (H, W) uint8
    settings : DetectSettings
    border : int
        Pixels along the image's edge without corners.
    hidden : callable, optional
        Which pixels show what is not a landmark: there are no corners there.
    halve : bool, optional
        Whether to look at half resolution; where the image is wide enough unless given.
    """

    def __init__(
        self,
        image: Image,
        settings: DetectSettings,
        border: int,
        *,
        hidden: Hidden | None = None,
        halve: bool | None = None,
    ) -> None:
        self._image, self._settings, self._border = image, settings, border
        self._hidden = hidden
        self._halve = halves(image.shape[1]) if halve is None else halve

    @cached_property
    def _peaks(self) -> Array:
        peaks = self._all
        return peaks if self._hidden is None else peaks[~self._hidden(peaks)]

    @cached_property
    def _all(self) -> Array:
        distance = _distance(self._image, self._settings)
        return corner_peaks(self._image, self._settings, distance, max(1, self._border), self._halve)

    def strongest(self, where: Hidden, count: int) -> Array:
        """At most so many of the strongest corners where ``where`` says, hidden or not: (M, 2) float64."""
        return self._all[where(self._all)][:count]

    def pick(self, existing: Array, count: int) -> Array:
        """As :func:`detect_corners` of the image: (M, 2) float64."""
        if count <= 0:
            return np.empty((0, 2), dtype=np.float64)
        return _spread(self._image, self._peaks, existing, count, self._settings)


def detect_corners(
    image: Image,
    existing: Array,
    count: int,
    settings: DetectSettings,
    mask_border: int,
    halve: bool | None = None,
    hidden: Hidden | None = None,
) -> Array:
    """At most ``count`` new corners, those first whose part of the image needs them most.

    The response is found once over the whole image; then each cell of a grid offers its corners by strength,
    and a corner's rank is the number of points its cell holds before it (existing ones included).

    Parameters
    ----------
    image : (H, W) uint8
    existing : (N, 2) float64
        Points that are tracked already (u, v); new corners keep their distance from them.
    count : int
    settings : DetectSettings
    mask_border : int
        Pixels along the image's edge without corners.
    halve : bool, optional
        Whether to look at half resolution; where the image is wide enough unless given.
    hidden : callable, optional
        Which pixels show what is not a landmark.

    Returns
    -------
    (M, 2) float64
        Corners (u, v), the most wanted first.
    """
    return Corners(image, settings, mask_border, hidden=hidden, halve=halve).pick(existing, count)


def _distance(image: Image, settings: DetectSettings) -> float:
    return float(max(2.0, settings.min_distance * image.shape[1]))


def _spread(
    image: Image,
    peaks: Array,
    existing: Array,
    count: int,
    settings: DetectSettings,
) -> Array:
    """The ``count`` peaks whose cells need them most, away from existing points."""
    distance = _distance(image, settings)
    chosen = _core.spread_corners(peaks, existing, count, image.shape, settings.cells, distance)
    corners = peaks[chosen]
    return refine_corners(image, corners) if settings.subpixel else corners

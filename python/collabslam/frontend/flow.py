"""Optical flow between consecutive frames: guesses for the search, and tracks of candidates.

A strong rotation moves the image by far more than a flow window.  So the motion of the whole image is found
first: as the filter predicts its features, or, where there are too few or the flow does not find them there,
on strongly downsampled images: the shift is where the shared part correlates best, an alignment by the
enhanced correlation coefficient adds the roll, and the alternative that leaves the images most alike is kept.
It is the start of a pyramidal Lucas-Kanade flow at half resolution: the search refines the guess at full
resolution by correlation.  The flow takes brightness as constant, so where the exposure has changed by a step
the previous image is first made as bright as the present one.
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from collabslam.frontend.detect import halves
from collabslam.settings.frontend import FlowSettings
from collabslam.types import Array, Image, Mask

Small = NDArray[np.float32]

MAX_ERROR = 1.5
"""Largest distance between a point and itself tracked forth and back, pixels."""
WINDOW = 15
"""Side of the flow's window, pixels."""
_SMALL_WIDTH = 64  # pixels, largest width of the small images from which the global motion is found
_MIN_POINTS = 8  # that tell the motion of the image
_MIN_FOLLOWED = 0.7  # share of the points; fewer mean that the first guess was wrong
_CELLS = (24, 16)  # of the image, columns and rows, whose brightness is compared
_AGREEING = 0.9  # share of them that a step of the exposure changes the same way
_MIN_OVERLAP = 0.3  # share of the small image in which both views must lie for a shift to count


def _halved(image: Image, times: int) -> Image:
    """The image, halved some times."""
    for _ in range(times):
        image = np.asarray(cv2.pyrDown(image), dtype=np.uint8)
    return image


class FlowImage:
    """The reduced images of one frame that the flow works on, made once.

    Parameters
    ----------
    image : (H, W) uint8

    Attributes
    ----------
    factor : int
        Full pixels in one of ``image``.
    image : (h, w) uint8
        What the flow is computed on: half resolution, or full where that is small already.
    """

    def __init__(self, image: Image) -> None:
        self.factor = 2 if halves(image.shape[1]) else 1
        # A copy even where nothing is halved: a camera's driver may write its next image over this one.
        self.image = _halved(image, 1) if self.factor == 2 else image.copy()

    @classmethod
    def again(cls, image: Image, factor: int) -> FlowImage:
        """One whose attributes ``image`` and ``factor`` were kept."""
        made = cls.__new__(cls)
        made.image, made.factor = image, factor
        return made

    def as_bright_as(self, now: FlowImage) -> FlowImage:
        """This image with the exposure of another one, if that has changed by a step.

        Exposure multiplies all grey values, gamma or not: nearly all cells of the image become brighter, or
        nearly all darker.  What moves into view makes some brighter and others darker.
        """
        before, after = (cv2.resize(i.image, _CELLS, interpolation=cv2.INTER_AREA) for i in (self, now))
        few, ratio, most = np.quantile((after + 1.0) / (before + 1.0), [1.0 - _AGREEING, 0.5, _AGREEING])
        if few <= 1.0 <= most:
            return self
        lit = np.asarray(cv2.convertScaleAbs(self.image, alpha=float(ratio)), dtype=np.uint8)
        return FlowImage.again(lit, self.factor)

    @cached_property
    def small(self) -> tuple[Small, Small, int]:
        """For the global motion: strongly reduced, the same without its slow changes, full pixels in one."""
        halvings = max(0, int(np.ceil(np.log2(self.image.shape[1] / _SMALL_WIDTH))))
        small = _halved(self.image, halvings).astype(np.float32)
        band = small - cv2.GaussianBlur(small, (0, 0), small.shape[1] / 8.0)
        return small, band, self.factor * 2**halvings


def global_motion(previous: FlowImage, now: FlowImage) -> Array:
    """Rigid motion (shift and roll) of the image content between two frames.

    Returns
    -------
    (2, 3) float64
        ``uv_now = m[:, :2] @ uv_previous + m[:, 2]``, pixels; the identity where nothing explains the images
        better.
    """
    (a, band, factor), (b, band_now, _) = previous.small, now.small
    if min(a.shape) < 8:
        return np.eye(2, 3)
    shift = _best_shift(band, band_now)
    starts = [
        np.eye(2, 3, dtype=np.float32),
        np.array([[1, 0, shift[0]], [0, 1, shift[1]]], dtype=np.float32),
    ]
    scores = [_similarity(a, b, start) for start in starts]
    best = starts[int(np.argmax(scores))]
    score = max(scores)
    try:
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 12, 1e-3)
        _, refined = cv2.findTransformECC(a, b, best.copy(), cv2.MOTION_EUCLIDEAN, stop)
        turned = np.asarray(refined, dtype=np.float32)
        if _similarity(a, b, turned) > score:
            best = turned
    except cv2.error:  # the alignment did not converge: the shift stands
        pass
    motion = best.astype(np.float64)
    # Halving keeps every second pixel: pixel i of the small image is pixel factor * i.
    motion[:, 2] *= factor
    return motion


def _best_shift(x: Small, y: Small) -> tuple[float, float]:
    """Shift (u, v) from ``x`` to ``y``, whole pixels, at which the part they share is most alike.

    Every shift that leaves ``_MIN_OVERLAP`` of the image in both is tried.
    """
    height, width = x.shape
    pad_u, pad_v = int((1.0 - _MIN_OVERLAP) * width), int((1.0 - _MIN_OVERLAP) * height)
    ones, wide_ones, count = _windows(x.shape, pad_u, pad_v)
    wide_y = cv2.copyMakeBorder(y, pad_v, pad_v, pad_u, pad_u, cv2.BORDER_CONSTANT)
    product = cv2.matchTemplate(wide_y, x, cv2.TM_CCORR)
    energy_a = cv2.matchTemplate(wide_ones, x * x, cv2.TM_CCORR)
    energy_b = cv2.matchTemplate(wide_y * wide_y, ones, cv2.TM_CCORR)
    similarity = product / np.sqrt(np.maximum(energy_a * energy_b, 1e-3))
    # A small overlap is alike by chance more often: its similarity counts less.
    similarity = np.where(count >= _MIN_OVERLAP * x.size, similarity * np.sqrt(count / x.size), -1.0)
    v, u = np.unravel_index(int(np.argmax(similarity)), similarity.shape)
    return float(u) - pad_u, float(v) - pad_v


@lru_cache(maxsize=4)
def _windows(shape: tuple[int, int], pad_u: int, pad_v: int) -> tuple[Small, Small, Small]:
    """An image of ones, the same with a border of zeros, and how many pixels both share at each shift."""
    ones = np.ones(shape, dtype=np.float32)
    wide = np.pad(ones, ((pad_v, pad_v), (pad_u, pad_u)))
    count = np.asarray(cv2.matchTemplate(wide, ones, cv2.TM_CCORR), dtype=np.float32)
    return ones, wide, count


@lru_cache(maxsize=4)
def _grid(shape: tuple[int, int]) -> Small:
    """(2, H, W) rows and columns of the pixels of a small image."""
    grid = np.indices(shape, dtype=np.float32)
    grid.flags.writeable = False
    return grid


def _similarity(a: Small, b: Small, motion: Small) -> float:
    """Correlation of the part that two small images share under a motion; -1 if they share too little."""
    v, u = _grid(a.shape)
    (a00, a01, t0), (a10, a11, t1) = motion
    maps = (a00 * u + a01 * v + t0, a10 * u + a11 * v + t1)
    moved = cv2.remap(b, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=-1e6)
    shared = moved >= 0.0
    if shared.mean() < _MIN_OVERLAP:
        return -1.0
    x, y = a[shared], moved[shared]
    x, y = x - x.mean(), y - y.mean()
    return float((x * y).sum() / max(1e-9, float(np.sqrt((x * x).sum() * (y * y).sum()))))


def motion_of(before: Array, now: Array) -> Array | None:
    """Shift, roll and scale that take points of one frame to those of the next (least squares).

    Parameters
    ----------
    before, now : (N, 2) float64

    Returns
    -------
    (2, 3) float64 or None
        As :func:`global_motion`; None where too few points say it.
    """
    if len(before) < _MIN_POINTS:
        return None
    middle, middle_now = before.mean(axis=0), now.mean(axis=0)
    p, q = (before - middle) @ [1.0, 1.0j], (now - middle_now) @ [1.0, 1.0j]
    turn = np.vdot(p, q) / max(float(np.vdot(p, p).real), 1e-9)
    linear = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]])
    return np.column_stack([linear, middle_now - linear @ middle])


def flow_guess(
    previous: FlowImage,
    now: FlowImage,
    uv_prev: Array,
    settings: FlowSettings,
    motion: Array | None = None,
    window: int = WINDOW,
) -> tuple[Array, Mask]:
    """Where points of the previous image are now, to about a pixel.

    Parameters
    ----------
    previous, now : FlowImage
    uv_prev : (N, 2) float64
    settings : FlowSettings
    motion : (2, 3) float64, optional
        Motion of the image as predicted (`motion_of`): the first guess.  The global motion takes its place if
        it is not given, and serves as a second guess if the flow from the first one fails for many points.
    window : int
        Side of the flow's window, pixels of its images.

    Returns
    -------
    uv : (N, 2) float64
    ok : (N,) bool
        Whether the point, tracked forth and back, came home within :data:`MAX_ERROR`.
    """
    points = np.asarray(uv_prev, dtype=np.float64).reshape(-1, 2)
    if len(points) == 0:
        return points.copy(), np.empty(0, dtype=np.bool_)
    predicted = motion is not None
    if motion is None:
        motion = global_motion(previous, now)
    start = points @ motion[:, :2].T + motion[:, 2]
    lit = previous.as_bright_as(now)
    uv, ok = _forth_and_back(lit, now, points, start, settings, window)
    if predicted and ok.mean() < _MIN_FOLLOWED:
        motion = global_motion(previous, now)
        moved = points @ motion[:, :2].T + motion[:, 2]
        again = np.flatnonzero(~ok & (np.abs(start - moved).max(axis=1) > 2.0))
        if len(again):
            uv[again], ok[again] = _forth_and_back(lit, now, points[again], moved[again], settings, window)
    return uv, ok


def _forth_and_back(
    previous: FlowImage, now: FlowImage, points: Array, start: Array, settings: FlowSettings, window: int
) -> tuple[Array, Mask]:
    """Lucas-Kanade flow to the frame now and back; full pixels."""
    a, b, factor = previous.image, now.image, float(now.factor)
    uv, gap = there_and_back(a, b, points / factor, start / factor, settings.levels, (12, 0.03), window)
    return uv * factor, gap * factor <= MAX_ERROR


def there_and_back(
    a: Image,
    b: Image,
    points: Array,
    start: Array,
    levels: int,
    stop: tuple[int, float],
    window: int = WINDOW,
) -> tuple[Array, Array]:
    """Lucas-Kanade flow of points from one image to another, and back.

    Parameters
    ----------
    a, b : (H, W) uint8
    points, start : (N, 2) float64
        Pixels in ``a``, and where to look for them in ``b``.
    levels : int
        Of the pyramid, besides the image itself.
    stop : (int, float)
        Steps at most, and the last one's length, pixels.
    window : int
        Side of the window that is compared, pixels.

    Returns
    -------
    uv : (N, 2) float64
        Pixels in ``b``.
    gap : (N,) float64
        Distance of each point from itself, when it has come home, pixels; infinite where it was not found or
        left the image.
    """
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, *stop)
    p = points.astype(np.float32).reshape(-1, 1, 2)
    first = start.astype(np.float32).reshape(-1, 1, 2)
    q, seen, _ = cv2.calcOpticalFlowPyrLK(
        a, b, p, first.copy(), winSize=(window, window), maxLevel=levels,
        criteria=criteria, flags=cv2.OPTFLOW_USE_INITIAL_FLOW, minEigThreshold=1e-4,
    )  # fmt: skip
    # The way back starts from the undone guess: the point itself would be confirmed too easily.
    home, back, _ = cv2.calcOpticalFlowPyrLK(
        b, a, q, q - first + p, winSize=(window, window), maxLevel=levels,
        criteria=criteria, flags=cv2.OPTFLOW_USE_INITIAL_FLOW, minEigThreshold=1e-4,
    )  # fmt: skip
    uv = q.reshape(-1, 2).astype(np.float64)
    gap = np.abs(home - p).reshape(-1, 2).max(axis=1)
    inside = np.all((uv >= 0.0) & (uv <= [b.shape[1] - 1.0, b.shape[0] - 1.0]), axis=1)
    found = (seen.ravel() == 1) & (back.ravel() == 1) & inside
    return uv, np.where(found, gap, np.float32(np.inf))

"""Active search: a template is looked for only where the filter expects it (METHOD section 7).

Zero-normalised cross-correlation (ZNCC) inside the ellipse of the predicted pixel's covariance, a test
against low and ambiguous peaks, then the peak's sub-pixel position.
"""

from __future__ import annotations

import enum

import numpy as np

from collabslam._core import ExpectedPixels, PeakTest, SearchResult, SearchWindow, search_templates
from collabslam.settings.frontend import SearchSettings
from collabslam.types import Array, Image, Mask

FOUND, LOW_SCORE, AMBIGUOUS, OUTSIDE, WIDE = 0, 1, 2, 3, 4
"""Codes of `SearchResult`; WIDE is not searched."""
GATE = 3.0
"""Radius of the search ellipse in standard deviations of S."""
_MIN_RADIUS = 2.5  # pixels, least radius of the search ellipse
_LARGE_RADIUS = (
    16.0  # pixels, above which an ellipse is not searched whole where flow offers a guess inside it
)
_GUESS_RADIUS = 6.0  # pixels, half side of the window searched around a guess
_GUESS_GATE = 1.5  # factor on the ellipse inside which a guess is used
_AMBIGUITY = 0.94  # a second peak above this share of the best score makes a match ambiguous
_PEAK_DISTANCE = 3.0  # pixels; peaks nearer than this to the best one belong to it
_MIN_DEVIATION = 4.0  # grey levels, least standard deviation of a template; a flatter one cannot be located


class SearchCode(enum.IntEnum):
    """Outcome of one search."""

    FOUND = FOUND
    LOW_SCORE = LOW_SCORE
    AMBIGUOUS = AMBIGUOUS
    OUTSIDE = OUTSIDE
    WIDE = WIDE


def wide_ellipses(s: Array) -> Mask:
    """(N,) bool: whether an ellipse is so wide that :func:`active_search` would use a guess inside it."""
    diagonal = np.asarray(s, dtype=np.float64)[:, [0, 1], [0, 1]]
    radius = np.sqrt(GATE**2 * diagonal.max(axis=1, initial=0.0) + _MIN_RADIUS**2)
    # Rounding must not decide otherwise than the search does.
    return np.asarray(radius > _LARGE_RADIUS - 1e-6)


def active_search(
    image: Image,
    templates: Image,
    uv_pred: Array,
    s: Array,
    guess: Array | None,
    settings: SearchSettings,
    whole: bool = True,
    scarce: bool = False,
) -> SearchResult:
    """Look for each template inside the ellipse of its predicted pixel.

    An ellipse wider than 16 pixels is not searched whole if ``guess`` lies in it (generously):
    then a small window around the guess is.  Without a guess the window is capped at ``search.max_radius``,
    so one template costs at most one correlation over (2 max_radius + 1)^2 positions.

    Parameters
    ----------
    image : (H, W) uint8
    templates : (N, h, h) uint8
    uv_pred : (N, 2) float64
        Predicted pixels.
    s : (N, 2, 2) float64
        Covariance of each predicted pixel, pixel noise included, px^2.
    guess : (N, 2) float64, optional
        Where optical flow says the point is; NaN where it does not say.
    settings : SearchSettings
    whole : bool
        Whether a wide ellipse without a guess is searched; otherwise its code is WIDE.
    scarce : bool
        Whether few features are left, so that of a patch in a noisy image less is asked for.

    Returns
    -------
    SearchResult
    """
    expected = ExpectedPixels(uv_pred, s, guess)
    window, peaks = search_window(settings.max_radius), peak_test(settings.min_score, scarce=scarce)
    return search_templates(image, templates, expected, window, peaks, whole=whole)


def search_around(
    image: Image, templates: Image, uv_pred: Array, s: Array, window: SearchWindow, peaks: PeakTest
) -> SearchResult:
    """As :func:`active_search`, in a window and with a test of the peaks of the caller's own."""
    return search_templates(image, templates, ExpectedPixels(uv_pred, s, None), window, peaks)


def search_window(
    max_radius: float, *, min_radius: float = _MIN_RADIUS, large_radius: float = _LARGE_RADIUS
) -> SearchWindow:
    """Where a template is searched; radii in pixels."""
    return SearchWindow(
        gate=GATE,
        min_radius=min_radius,
        large_radius=large_radius,
        max_radius=max_radius,
        guess_radius=_GUESS_RADIUS,
        guess_gate=_GUESS_GATE,
    )


def peak_test(min_score: float, *, ambiguity: float = _AMBIGUITY, scarce: bool = False) -> PeakTest:
    """Which peaks of the correlation count as found."""
    return PeakTest(
        min_score=min_score,
        ambiguity=ambiguity,
        peak_distance=_PEAK_DISTANCE,
        min_deviation=_MIN_DEVIATION,
        scarce=scarce,
    )

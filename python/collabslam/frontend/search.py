"""Active search: a template is looked for only where the filter expects it (METHOD section 7).

Zero-normalised cross-correlation (ZNCC) inside the ellipse of the predicted pixel's covariance, a test
against low and ambiguous peaks, then the peak's sub-pixel position.
"""

from __future__ import annotations

import enum

import numpy as np

from collabslam._core import ExpectedPixels, PeakTest, SearchResult, SearchWindow, search_templates
from collabslam.settings.frontend import FrontendSettings, SearchSettings
from collabslam.types import Array, Image, Mask

FOUND, LOW_SCORE, AMBIGUOUS, OUTSIDE, WIDE = 0, 1, 2, 3, 4
"""Codes of `SearchResult`; WIDE is not searched."""


class SearchCode(enum.IntEnum):
    """Outcome of one search."""

    FOUND = FOUND
    LOW_SCORE = LOW_SCORE
    AMBIGUOUS = AMBIGUOUS
    OUTSIDE = OUTSIDE
    WIDE = WIDE


def wide_ellipses(s: Array, settings: SearchSettings) -> Mask:
    """(N,) bool: whether an ellipse is so wide that :func:`active_search` would use a guess inside it."""
    diagonal = np.asarray(s, dtype=np.float64)[:, [0, 1], [0, 1]]
    radius = np.sqrt(settings.gate**2 * diagonal.max(axis=1, initial=0.0) + settings.min_radius**2)
    # Rounding must not decide otherwise than the search does.
    return np.asarray(radius > settings.large_radius - 1e-6)


def active_search(
    image: Image,
    templates: Image,
    uv_pred: Array,
    s: Array,
    guess: Array | None,
    settings: FrontendSettings,
    whole: bool = True,
) -> SearchResult:
    """Look for each template inside the ellipse of its predicted pixel.

    An ellipse wider than ``search.large_radius`` is not searched whole if ``guess`` lies in it (generously):
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
    settings : FrontendSettings
    whole : bool
        Whether a wide ellipse without a guess is searched; otherwise its code is WIDE.

    Returns
    -------
    SearchResult
    """
    options = settings.search
    window = SearchWindow(
        gate=options.gate,
        min_radius=options.min_radius,
        large_radius=options.large_radius,
        max_radius=options.max_radius,
        guess_radius=options.guess_radius,
        guess_gate=options.guess_gate,
    )
    peaks = PeakTest(
        min_score=options.min_score,
        ambiguity=options.ambiguity,
        peak_distance=options.peak_distance,
        min_deviation=settings.patch.min_deviation,
    )
    expected = ExpectedPixels(uv_pred, s, guess)
    return search_templates(image, templates, expected, window, peaks, whole=whole)

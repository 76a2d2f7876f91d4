"""Active search: a template is looked for only where the filter expects it (METHOD section 7).

Zero-normalised cross-correlation (ZNCC) inside the ellipse of the predicted pixel's covariance, a test
against low and ambiguous peaks, then the peak's sub-pixel position.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from collabslam.frontend.settings import FrontendSettings
from collabslam.types import Array, Image, Indices

FOUND, LOW_SCORE, AMBIGUOUS, OUTSIDE = 0, 1, 2, 3

_STEPS = 3  # of the sub-pixel alignment


class SearchCode(enum.IntEnum):
    """Outcome of one search."""

    FOUND = FOUND
    LOW_SCORE = LOW_SCORE
    AMBIGUOUS = AMBIGUOUS
    OUTSIDE = OUTSIDE


class SearchResult(NamedTuple):
    """Outcome of an active search.

    Attributes
    ----------
    uv : (N, 2) float64
        Sub-pixel position of the best peak; NaN where there is none.
    score : (N,) float64
        Its correlation; -1 where there is none.
    second : (N,) float64
        Correlation of the next best peak that does not belong to it; -1 where there is none.
    code : (N,) int64
        FOUND, LOW_SCORE, AMBIGUOUS or OUTSIDE.
    """

    uv: Array
    score: Array
    second: Array
    code: Indices


def build_pyramid(image: Image, levels: int = 3) -> list[Image]:
    """The image and ``levels`` halvings of it, the full one first."""
    pyramid = [image]
    for _ in range(levels):
        pyramid.append(np.asarray(cv2.pyrDown(pyramid[-1]), dtype=np.uint8))
    return pyramid


def active_search(
    pyramid: Sequence[Image],
    templates: Image,
    uv_pred: Array,
    s: Array,
    guess: Array | None,
    settings: FrontendSettings,
) -> SearchResult:
    """Look for each template inside the ellipse of its predicted pixel.

    An ellipse wider than ``search.large_radius`` is not searched whole if ``guess`` lies in it (generously):
    then a small window around the guess is.  Without a guess the window is capped at ``search.max_radius``,
    so one template costs at most one correlation over (2 max_radius + 1)^2 positions.

    Parameters
    ----------
    pyramid : sequence of (H, W) uint8
        Image pyramid, full resolution first; the search uses the full resolution.
    templates : (N, h, h) uint8
    uv_pred : (N, 2) float64
        Predicted pixels.
    s : (N, 2, 2) float64
        Covariance of each predicted pixel, pixel noise included, px^2.
    guess : (N, 2) float64, optional
        Where optical flow says the point is; NaN where it does not say.
    settings : FrontendSettings

    Returns
    -------
    SearchResult
    """
    image = pyramid[0]
    options = settings.search
    count = len(templates)
    uv = np.full((count, 2), np.nan)
    score, second = np.full(count, -1.0), np.full(count, -1.0)
    code = np.full(count, OUTSIDE, dtype=np.int64)
    if count == 0:
        return SearchResult(uv, score, second, code)
    centre = np.array(uv_pred, dtype=np.float64).reshape(-1, 2)
    floor = (options.min_radius / options.gate) ** 2
    shape = np.asarray(s, dtype=np.float64) + floor * np.eye(2)
    radius = options.gate * np.sqrt(np.stack([shape[:, 0, 0], shape[:, 1, 1]], axis=1))
    finite = np.all(np.isfinite(centre), axis=1) & np.all(np.isfinite(shape), axis=(1, 2))
    precision = np.zeros_like(shape)
    precision[finite] = np.linalg.inv(shape[finite])
    limit = np.full(count, options.gate**2)
    if guess is not None:
        shift = np.asarray(guess, dtype=np.float64) - centre
        distance = np.einsum("ni,nij,nj->n", shift, precision, shift)
        believed = (radius.max(axis=1) > options.large_radius) & (
            distance <= (options.gate * options.guess_gate) ** 2
        )
        centre[believed] = np.asarray(guess)[believed]
        radius[believed] = options.guess_radius
        precision[believed] = np.eye(2) / options.guess_radius**2
        limit[believed] = 2.0
    half = templates.shape[1] // 2
    reach = np.minimum(np.ceil(radius), options.max_radius)
    start = np.where(finite[:, None], centre, -1e6)
    low = np.maximum(np.floor(start - reach), half).astype(np.int64)
    high = np.minimum(np.ceil(start + reach), [image.shape[1] - 1 - half, image.shape[0] - 1 - half]).astype(
        np.int64
    )
    # One more pixel all around, where the image has it, tells a peak from the slope of one outside.
    low, high = (
        np.maximum(low - 1, half),
        np.minimum(high + 1, [image.shape[1] - 1 - half, image.shape[0] - 1 - half]),
    )
    possible = np.flatnonzero(np.all(high - low >= 2, axis=1))
    sizes = (high - low + 1)[possible]
    flat = templates.reshape(count, -1).std(axis=1) < settings.patch.min_deviation
    code[possible] = LOW_SCORE
    todo = np.flatnonzero(~flat[possible])
    order = todo[np.argsort(sizes[todo].max(axis=1), kind="stable")]
    begin = 0
    while begin < len(order):  # maps of like size are judged together
        largest = max(24, int(1.5 * sizes[order[begin]].max()))
        end = begin + int(np.searchsorted(sizes[order[begin:]].max(axis=1), largest, side="right"))
        group = possible[order[begin:end]]
        begin = end
        found = _search_group(
            image, templates, group, low, high, centre, precision, limit, options.peak_distance
        )
        uv[group], score[group], second[group] = found
    good = score >= options.min_score
    uv[good] = align_templates(image, templates[good], uv[good])
    unique = second < options.ambiguity * score
    code[good & unique] = FOUND
    code[good & ~unique] = AMBIGUOUS
    return SearchResult(uv, score, second, code)


def _search_group(
    image: Image,
    templates: Image,
    group: Indices,
    low: Indices,
    high: Indices,
    centre: Array,
    precision: Array,
    limit: Array,
    apart: float,
) -> tuple[Array, Array, Array]:
    """Best and second peak of the correlation maps of a group, all maps padded to one size."""
    half = templates.shape[1] // 2
    sizes = high[group] - low[group] + 1
    width, height = int(sizes[:, 0].max()), int(sizes[:, 1].max())
    # A guard column and row between the maps keeps the 3 x 3 maximum filter from joining them.
    maps = np.full((len(group), height + 1, width + 1), -2.0, dtype=np.float32)
    for k, i in enumerate(group):
        (u0, v0), (u1, v1) = low[i] - half, high[i] + half + 1
        result = cv2.matchTemplate(image[v0:v1, u0:u1], templates[i], cv2.TM_CCOEFF_NORMED)
        maps[k, : result.shape[0], : result.shape[1]] = result
    highest = cv2.dilate(maps.reshape(-1, width + 1), np.ones((3, 3), np.uint8)).reshape(maps.shape)
    du = (np.arange(width + 1) + low[group, 0][:, None] - centre[group, 0][:, None]).astype(np.float32)
    dv = (np.arange(height + 1) + low[group, 1][:, None] - centre[group, 1][:, None]).astype(np.float32)
    p = precision[group].astype(np.float32)
    which, row, column = np.nonzero((maps == highest) & (maps > 0.0))
    x, y = du[which, column], dv[which, row]
    weight = p[which]
    distance = weight[:, 0, 0] * x * x + 2.0 * weight[:, 0, 1] * x * y + weight[:, 1, 1] * y * y
    border = (row == 0) | (column == 0) | (row == sizes[which, 1] - 1) | (column == sizes[which, 0] - 1)
    keep = (distance <= limit[group][which]) & ~border
    which, row, column = which[keep], row[keep], column[keep]
    value = maps[which, row, column]
    order = np.lexsort((row, column, -value, which))
    which, row, column, value = which[order], row[order], column[order], value[order]
    n = len(group)
    uv = np.full((n, 2), np.nan)
    score, second = np.full(n, -1.0), np.full(n, -1.0)
    first = np.flatnonzero(np.r_[True, which[1:] != which[:-1]]) if len(which) else np.empty(0, np.int64)
    best = which[first]
    score[best] = value[first]
    peak = np.zeros((n, 2), dtype=np.int64)
    peak[best, 0], peak[best, 1] = column[first], row[first]
    far = (column - peak[which, 0]) ** 2 + (row - peak[which, 1]) ** 2 > apart**2
    np.maximum.at(second, which[far], value[far].astype(np.float64))
    offset = quadratic_peak(
        maps[
            best[:, None, None],
            row[first][:, None, None] + np.array([-1, 0, 1])[None, :, None],
            column[first][:, None, None] + np.array([-1, 0, 1])[None, None, :],
        ].astype(np.float64)
    )
    uv[best] = peak[best] + low[group][best] + offset
    return uv, score, second


def align_templates(image: Image, templates: Image, uv: Array) -> Array:
    """Sub-pixel alignment of templates by Gauss-Newton steps over shift, gain and offset.

    The quadratic surface of a correlation peak is off by up to a tenth of a pixel where the texture is not
    symmetric; this is not.

    Parameters
    ----------
    image : (H, W) uint8
    templates : (N, h, h) uint8
    uv : (N, 2) float64
        Positions to within about half a pixel, at least half a template from the image's edge.

    Returns
    -------
    (N, 2) float64
        A position that would move by more than a pixel stays where it was.
    """
    count = len(templates)
    if count == 0:
        return uv
    inner = templates[:, 1:-1, 1:-1].astype(np.float32)
    side = inner.shape[1]
    columns = np.empty((count, 4, side * side), dtype=np.float32)
    columns[:, 0] = (0.5 * (templates[:, 1:-1, 2:].astype(np.float32) - templates[:, 1:-1, :-2])).reshape(
        count, -1
    )
    columns[:, 1] = (0.5 * (templates[:, 2:, 1:-1].astype(np.float32) - templates[:, :-2, 1:-1])).reshape(
        count, -1
    )
    columns[:, 2] = inner.reshape(count, -1) - inner.mean(axis=(1, 2))[:, None]
    columns[:, 3] = 1.0
    normal = (columns @ columns.transpose(0, 2, 1)).astype(np.float64)
    normal += 1e-6 * normal.trace(axis1=1, axis2=2)[:, None, None] * np.eye(4)
    inverse = np.linalg.inv(normal)
    line = np.arange(side) - (side - 1) / 2.0
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    moved = uv.copy()
    for _ in range(_STEPS):
        sampled = cv2.remap(
            image,
            (moved[:, :1] + x).astype(np.float32),
            (moved[:, 1:] + y).astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        ).astype(np.float32)
        fit = np.einsum("nij,nj->ni", inverse, (columns @ sampled[:, :, None])[..., 0])
        gain = np.where(fit[:, 2] > 0.1, fit[:, 2], np.inf)
        moved -= np.clip(fit[:, :2] / gain[:, None], -0.5, 0.5)
    near = np.abs(moved - uv).max(axis=1) <= 1.0
    return np.where(near[:, None], moved, uv)


def quadratic_peak(values: Array) -> Array:
    """Offset (u, v) of the maximum of the quadratic surface fitted to 3 x 3 values around a peak.

    Parameters
    ----------
    values : (N, 3, 3) float64
        Rows are v, columns are u; the largest value is in the middle.

    Returns
    -------
    (N, 2) float64
        Within one pixel; zero where the surface has no maximum.
    """
    columns, rows = values.sum(axis=1), values.sum(axis=2)
    gu, gv = (columns[:, 2] - columns[:, 0]) / 6.0, (rows[:, 2] - rows[:, 0]) / 6.0
    huu = (columns[:, 0] - 2.0 * columns[:, 1] + columns[:, 2]) / 3.0
    hvv = (rows[:, 0] - 2.0 * rows[:, 1] + rows[:, 2]) / 3.0
    huv = (values[:, 0, 0] + values[:, 2, 2] - values[:, 0, 2] - values[:, 2, 0]) / 4.0
    det = huu * hvv - huv**2
    peaked = (det > 1e-12) & (huu < 0.0)
    det = np.where(peaked, det, 1.0)
    offset = np.stack([huv * gv - hvv * gu, huv * gu - huu * gv], axis=1) / det[:, None]
    good = peaked & (np.abs(offset).max(axis=1) <= 1.0)
    return np.where(good[:, None], offset, 0.0)

"""What the images of one camera tell of its calibration without any poses.

Two views of a rigid scene fit an essential matrix only if the focal length is right, and how much so depends
on the motion: looking straight ahead down a corridor tells nothing.  So the motion between pairs of frames
is fitted anew for each focal length tried, and the pairs vote with what is left of their matches.  Mirrored
images of a rigid scene are images of the mirrored scene: a camera alone cannot tell it from the true one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from collabslam.checks.matching import LEAST_MATCHES, Matches, Points, describe, match_points
from collabslam.checks.mistakes import MirroredCamera
from collabslam.checks.relative_motion import CAP_PX, FINE_PX, refined
from collabslam.checks.samples import spread
from collabslam.geometry import pose
from collabslam.types import Array, Image

PAIRS = 12
LEAST_PAIRS = 5
_MOVED = 0.03
"""Median motion of the points of a pair that says something, as a share of the focal length."""
_EXCLUDED = 3.0
"""Standard errors over the pairs by which an excluded focal length fits worse than the best one."""
FACTORS = np.round(np.geomspace(0.5, 2.0, 29), 3)
"""Factors on the focal length that are tried; the middle one is 1."""


class FocalRange(NamedTuple):
    """Factors on the focal length that the images allow, the one they like best, and what it leaves.

    ``before`` and ``after`` are root mean square residuals, px, with the focal length given and the best one.
    """

    least: float
    most: float
    best: float
    before: float
    after: float

    @property
    def contradicts(self) -> bool:
        """Whether the calibrated focal length is not among those allowed."""
        return not self.least <= 1.0 <= self.most


def focal_range(
    image: Callable[[int], Image], frames: Sequence[int], model: MirroredCamera
) -> FocalRange | None:
    """Focal lengths that one camera's images allow.

    Parameters
    ----------
    image : callable
        (H, W) uint8 of a frame.
    frames : sequence of int
        Frames that have one, in order.
    model : MirroredCamera
        The camera as calibrated.

    Returns
    -------
    FocalRange or None
        None if too few pairs of frames move and share points.
    """
    pairs = _pairs(image, frames, model)
    if len(pairs) < LEAST_PAIRS:
        return None
    squares = np.array([_left(pair, model) for pair in pairs]) ** 2
    # Pairs of many matches that fit well must not drown the others, nor those that fit badly.
    costs = squares / np.maximum(squares.min(axis=1, keepdims=True), FINE_PX**2)
    best = int(np.argmin(costs.mean(axis=0)))
    above = costs - costs[:, [best]]
    error = above.std(axis=0, ddof=1) / np.sqrt(len(pairs))
    allowed = FACTORS[above.mean(axis=0) <= _EXCLUDED * error]
    middle = len(FACTORS) // 2
    typical = np.sqrt(np.median(squares, axis=0))
    half = float(np.sqrt(FACTORS[middle + 1]))  # what lies between two factors counts with either
    return FocalRange(
        float(allowed.min()) / half,
        float(allowed.max()) * half,
        float(FACTORS[best]),
        float(typical[middle]),
        float(typical[best]),
    )


def _pairs(image: Callable[[int], Image], frames: Sequence[int], model: MirroredCamera) -> list[Matches]:
    """Matches of frames far enough apart that their points have moved, outliers taken out."""
    known: dict[int, Points] = {}

    def points(k: int) -> Points:
        if k not in known:
            known[k] = describe(image(frames[k]))
        return known[k]

    pairs = []
    for k in spread(range(len(frames) - 1), PAIRS):
        for gap in (10, 5, 3, 2, 1):
            if k + gap >= len(frames):
                continue
            found = match_points(points(k), points(k + gap))
            if len(found.uv_a) < 2 * LEAST_MATCHES:
                continue
            if np.median(np.linalg.norm(found.uv_a - found.uv_b, axis=1)) > _MOVED * model.focal:
                pairs.append(_rigid(found, model))
            break
    return [p for p in pairs if len(p.uv_a) >= 2 * LEAST_MATCHES]


def _rigid(matches: Matches, model: MirroredCamera) -> Matches:
    """The matches that lie on the epipolar lines of one fundamental matrix, whatever the focal length."""
    a, b = (model.rays(uv)[:, :2] * model.focal for uv in matches)
    usable = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    a, b = a[usable], b[usable]
    if len(a) < 2 * LEAST_MATCHES:
        return Matches(np.empty((0, 2)), np.empty((0, 2)))
    cv2.setRNGSeed(0)
    _, mask = cv2.findFundamentalMat(a, b, cv2.USAC_MAGSAC, 1.0, 0.999, 2000)
    keep = np.zeros(len(a), bool) if mask is None else mask.ravel().astype(bool)
    return Matches(matches.uv_a[usable][keep], matches.uv_b[usable][keep])


def _left(matches: Matches, model: MirroredCamera) -> Array:
    """Root mean square residual of a pair for each of `FACTORS`, each with its own motion, px."""
    out = np.full(len(FACTORS), CAP_PX)
    a, b = model.rays(matches.uv_a), model.rays(matches.uv_b)
    cv2.setRNGSeed(0)
    essential, _ = cv2.findEssentialMat(a[:, :2], b[:, :2], np.eye(3), cv2.LMEDS, 0.999, 1.0, 300)
    if essential is None or essential.shape != (3, 3):
        return out
    _, turn, along, _ = cv2.recoverPose(essential, a[:, :2], b[:, :2], np.eye(3))
    middle = len(FACTORS) // 2
    for way in (range(middle, len(FACTORS)), range(middle - 1, -1, -1)):
        t_ba = pose(turn, along.ravel())  # each focal length starts from its neighbour's motion
        for k in way:
            scale = np.array([1.0 / FACTORS[k], 1.0 / FACTORS[k], 1.0])
            t_ba, left = refined(a * scale, b * scale, t_ba, model.focal * FACTORS[k])
            out[k] = float(np.sqrt(np.mean(np.minimum(np.abs(left), CAP_PX) ** 2)))
    return out

"""What two images say of a measured T_CF: the one test of a running filter, ``check-calib`` and ``doctor``.

Matches are found under a far wider prior than T_CF's own, so that the images answer and not the measurement.
They are then explained twice: by the pose near T_CF that most of them agree on within its covariance, and by
the one they agree on if it may be far off.  T_CF is contradicted where the second explains so much more, or
where the first has to move one of T_CF's six numbers so far, as errors within the covariance hardly ever
make it (METHOD 22).  How long T_CF is no match tells: the lines it is held against do not depend on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from collabslam._core import SURE_LEVEL, MatchNoise, chi2_quantile, epipolar_residuals, find_consensus
from collabslam.geometry import pose_inverse, se3_log
from collabslam.types import Array

WIDE = 100.0
"""Factor on T_CF's covariance when the images are asked."""
LEAST_AGREEING = 8
"""Fewer matches that agree with each other say nothing: any five lie on the lines of some pose."""
LEAST_VIEWS = 3
"""Fewer views that say something do not speak for a run."""
_LAST = 7
"""Views that together tell of a fault that has begun since."""
_TOGETHER = 0.8
"""`Verdict.against` that counts where most views reach it: the level of each test is then 0.999."""
SIGMA, LIMIT = 1.0, 3.0
"""Of a right match's residual, and the largest of one that agrees, px."""
INDEPENDENT = 20
"""Matches of a view whose residuals are taken as independent."""
_LINES = 5
"""Numbers of T_CF that epipolar lines depend on."""


class Verdict(NamedTuple):
    """What the images of one view say of T_CF.

    Attributes
    ----------
    correction : (6,) float64
        By which they alone move it: metres, then radians, tangent on the right.
    told : (6, 6) float64
        Covariance of the correction.
    against : float
        The worse of the two tests over its threshold: above 1 the view alone contradicts T_CF.
    """

    correction: Array
    told: Array
    against: float


def ask_images(
    rays_s: Array, rays_f: Array, t_cf: Array, covariance: Array, focal: tuple[float, float]
) -> Verdict | None:
    """What matches say of a measured pose; None where too few of them agree on any.

    Parameters
    ----------
    rays_s, rays_f : (M, 3) array
        Unit rays of the matches in C and F, found without leaning on T_CF.
    t_cf : (4, 4) array
        As measured: maps points of F into C, metres.
    covariance : (6, 6) array
        Of it, over (translation m, rotation rad), tangent on the right.
    focal : (float, float)
        Focal lengths of Cs and Cf, pixels per radian.
    """
    noise = MatchNoise(focal, SIGMA, LIMIT)
    free = find_consensus(rays_s, rays_f, t_cf, WIDE * covariance, noise)
    if free.agree.sum() < LEAST_AGREEING:
        return None
    bound = find_consensus(rays_s, rays_f, t_cf, covariance, noise)
    moved = {"free": _moved(t_cf, free.t_cf), "bound": _moved(t_cf, bound.t_cf)}
    costs = {
        name: _left(rays_s, rays_f, pose, focal) + float(moved[name] @ np.linalg.solve(prior, moved[name]))
        for name, pose, prior in (("free", free.t_cf, WIDE * covariance), ("bound", bound.t_cf, covariance))
    }
    less = (costs["bound"] - costs["free"]) / chi2_quantile(SURE_LEVEL, _LINES)
    farthest = float(np.max(moved["bound"] ** 2 / np.diag(covariance)))
    one_of_six = chi2_quantile(1.0 - (1.0 - SURE_LEVEL) / 6.0, 1)
    return Verdict(moved["free"], free.covariance, max(less, farthest / one_of_six))


def contradicted(against: Sequence[float] | Array) -> bool:
    """Whether most views that say something speak against T_CF.

    Parameters
    ----------
    against : (N,) array
        `Verdict.against` of the views; NaN where one says nothing.
    """
    told = np.asarray(against, np.float64)
    told = told[~np.isnan(told)]
    return len(told) >= LEAST_VIEWS and bool(np.mean(told > _TOGETHER) > 0.5)


def moved_too_far(squares: Array, lasting: Array) -> bool:
    """Whether the map moves T_CF farther, over all views together or the last ones, than errors within its
    covariance do.

    Of views with an error in common each says less than one of its own would: the sum is held against a
    chi-squared variable of its mean and variance.

    Parameters
    ----------
    squares : (N,) array
        Square of the error of T_CF that the filter finds in each view, in units of its covariance.
    lasting : (N,) array
        Share of that covariance that the views have in common.
    """
    for count in {len(squares), min(len(squares), _LAST)}:
        if count >= LEAST_VIEWS:
            each = 1.0 + (count - 1) * float(np.mean(lasting[-count:])) ** 2
            if np.sum(squares[-count:]) / each > chi2_quantile(SURE_LEVEL, 6.0 * count / each):
                return True
    return False


def contradicted_lately(against: Sequence[float] | Array) -> bool:
    """Whether most of the last views that say something contradict T_CF, each by itself.

    What was right before is not a defence of a T_CF, or of a calibration, that is wrong from some time on: of
    a camera that zooms.

    Parameters
    ----------
    against : (N,) array
        As of `contradicted`, in their order.
    """
    told = np.asarray(against, np.float64)
    told = told[~np.isnan(told)][-_LAST:]
    return len(told) == _LAST and bool(np.median(told) > 1.0)


def _moved(t_cf: Array, pose: Array) -> Array:
    return se3_log(pose_inverse(t_cf) @ pose)


def _left(rays_s: Array, rays_f: Array, pose: Array, focal: tuple[float, float]) -> float:
    """Squared residuals in standard deviations, none larger than a wrong match's."""
    values = epipolar_residuals(rays_s, rays_f, pose, focal).residual / SIGMA
    share = min(1.0, INDEPENDENT / len(values))
    return share * float(np.sum(np.minimum(np.abs(values), LIMIT / SIGMA) ** 2))

"""One error of T_CF and one offset of its clock that explain all views, and what no view tells of them.

The unknowns are a correction of six numbers, seconds, and the unit of Cs's path, which a filter lets drift:
each stretch of the path has its own.  A direction of the first seven counts as told where the views leave at
most a third of what was thought possible; along all others nothing is changed (METHOD section 26).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from collabslam._core import TOLD_INFORMATION
from collabslam.checks.worn_bias.seen import SeenPose
from collabslam.datasets.worn_calibration import WornCalibration, corrected
from collabslam.geometry import pose_inverse, se3_log
from collabslam.types import Array

AXES = ("right", "down", "forward", "turn about right", "turn about down", "turn about forward", "clock")
CLOCK_SD = 0.1
"""What the clock may be off by, seconds."""
WIDER = 2.0
"""What T_CF may be off by, in its stated standard deviations."""
_SCALE_SD = 0.3
"""What the logarithm of the path's unit may be off by."""
STRETCH = 10.0
"""Seconds for which a path keeps its unit."""
_GATE = 16.8
"""Squared residual of a view's six numbers that one of 100 exceeds."""
_CLOCK_SDS = 2.0
_MIXED = 0.1
"""Part of the clock in a direction that is not told from which on it is not told either."""
_STEPS = 15
_E = 1e-5


class AskedView(NamedTuple):
    """A view and what its images say.

    Attributes
    ----------
    t : float
        Its stamp, seconds.
    measured : (4, 4) float64
    white : (6, 6) float64
        Covariance of what errs in ``measured`` anew in every view, tangent on the right.
    seen : SeenPose
    """

    t: float
    measured: Array
    white: Array
    seen: SeenPose


@dataclass(frozen=True)
class BiasFit:
    """The correction that all views agree on.

    Attributes
    ----------
    calibration : WornCalibration
        The correction, along what the views tell.
    sd : (7,) float64
        Standard deviations of the correction, metres and radians along C's axes, and of the clock, seconds;
        of what is not told what was thought possible.
    units : (S,) float64
        Unit of Cs's path over metres in each stretch of it that has views, as the corrected poses have it.
    reduced_chi2 : float
        Squared residuals of the views over what they should be; 1 is right.
    views : int
        That were asked.
    untold : list of (7,) float64
        Unit directions that the views do not tell, in standard deviations of what was thought possible.
    """

    calibration: WornCalibration
    sd: Array
    units: Array
    reduced_chi2: float
    views: int
    untold: list[Array]


Later = Callable[[float, float], Array]
"""Of a time and an offset, seconds: the pose (4, 4) of Cs then, seen from Cs at that time."""


def fit_bias(views: Sequence[AskedView], later: Later, *, metric: bool = False) -> BiasFit:
    """The correction, clock and unit that explain the views best.

    A clock that is told, and within two of its standard deviations, counts as right.

    Parameters
    ----------
    views : sequence of AskedView
        One or more.
    later : callable
        Motion of Cs along its path.
    metric : bool
        Whether the path is in metres already.
    """
    possible = _possible(views)
    stretches = np.unique([int((view.t - views[0].t) // STRETCH) for view in views], return_inverse=True)[1]
    asked = list(zip(views, (7 + stretches).tolist(), strict=True))
    prior_sd = np.append(possible, np.full(stretches.max() + 1, 1e-6 if metric else _SCALE_SD))
    x, information, reduced_chi2 = _solved(asked, later, prior_sd)
    values, directions = _told(information, prior_sd)
    told = values > TOLD_INFORMATION
    variance = np.where(told, 1.0 / (1.0 + values), 1.0)
    covariance = np.outer(possible, possible) * ((directions * variance) @ directions.T)
    sd = np.sqrt(np.diag(covariance))
    clock_alone = bool(np.all(np.abs(directions[6, ~told]) < _MIXED))
    if clock_alone and abs(x[6]) < _CLOCK_SDS * sd[6]:
        x = _solved(asked, later, np.where(np.arange(len(x)) == 6, 1e-9, prior_sd))[0]
    inside = directions[:, told]
    kept = possible * (inside @ (inside.T @ (x[:7] / possible)))
    left = np.outer(possible, possible) * ((inside / (1.0 + values[told])) @ inside.T)
    clock = float(kept[6]) if abs(x[6]) > 1e-6 else 0.0
    calibration = WornCalibration(kept[:6], left[:6, :6], clock, float(sd[6]))
    untold = [np.array(d) for d in directions[:, ~told].T]
    return BiasFit(calibration, sd, np.exp(x[7:]), reduced_chi2, len(views), untold)


Asked = list[tuple[AskedView, int]]
"""Views, each with the number of the unknown that is the logarithm of its unit."""


def _solved(views: Asked, later: Later, prior_sd: Array) -> tuple[Array, Array, float]:
    """Unknowns (7 + S,), what the views alone tell of them (7 + S, 7 + S), and the reduced chi-square."""
    prior = np.diag(prior_sd**-2.0)
    x = np.zeros(len(prior_sd))
    for _ in range(_STEPS):
        information, gradient, _, _ = _normal(views, later, x)
        step = np.linalg.solve(information + prior, gradient - prior @ x)
        x = x + step
        if np.abs(step).max() < 1e-7:
            break
    information, _, square, expected = _normal(views, later, x)
    reduced_chi2 = square / max(expected, 1e-9)
    return x, information / max(reduced_chi2, 1.0), float(reduced_chi2)


def _told(information: Array, prior_sd: Array) -> tuple[Array, Array]:
    """What the views tell of the seven whatever the units: values (7,) over the prior's, and directions."""
    units = np.diag(information)[7:] + prior_sd[7:] ** -2.0
    seven = information[:7, :7] - (information[:7, 7:] / units) @ information[7:, :7]
    scaled = seven * np.outer(prior_sd[:7], prior_sd[:7])
    values, directions = np.linalg.eigh(0.5 * (scaled + scaled.T))
    return np.maximum(values, 0.0), directions


def _possible(views: Sequence[AskedView]) -> Array:
    """(7,) standard deviations of what the correction may be: alike along all axes."""
    mean = np.mean([np.diag(v.white) for v in views], axis=0)
    metres, radians = (WIDER * np.sqrt(mean[k : k + 3].mean()) for k in (0, 3))
    return np.array([metres] * 3 + [radians] * 3 + [CLOCK_SD])


def _residual(view: AskedView, later: Later, x: Array) -> Array:
    """Tangent (6,) from where the seven and a unit, ``x`` (8,), put Cf to where the images do."""
    expected = corrected(view.measured, x[:6])
    expected[:3, 3] *= np.exp(x[7])
    return se3_log(pose_inverse(later(view.t, float(x[6])) @ expected) @ view.seen.t_cf)


def _normal(views: Asked, later: Later, x: Array) -> tuple[Array, Array, float, float]:
    """Information, gradient, squared residuals of all views, and what they should be."""
    information, gradient = np.zeros((len(x), len(x))), np.zeros(len(x))
    square = expected = 0.0
    steps = np.append(np.full(6, _E), [1e-3, _E])
    for view, unit in views:
        own = np.append(np.arange(7), unit)
        here = x[own]
        r = _residual(view, later, here)
        by = np.empty((6, 8))
        for k, e in enumerate(steps):
            moved = np.zeros(8)
            moved[k] = e
            by[:, k] = _residual(view, later, here + moved) - _residual(view, later, here - moved)
        by /= 2.0 * steps
        weight = np.linalg.inv(view.seen.covariance + view.white)
        distance = float(r @ weight @ r)
        w = min(1.0, np.sqrt(_GATE / max(distance, 1e-12)))
        information[np.ix_(own, own)] += w * by.T @ weight @ by
        gradient[own] -= w * by.T @ weight @ r
        square += w * distance
        expected += w * float(np.trace(weight @ (view.seen.told + view.white)))
    return information, gradient, square, expected

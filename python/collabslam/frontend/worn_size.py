"""What the images of a view say of the map's size, by its points where they are not looked for by the map.

A map that has lost its scale puts its points where Cf does not show them.  Looked for there alone they are
not found, and what Cf could tell is not asked.  So those that match along their whole line are compared:
points of a map that is right are where it says, those of one that is too small or too large are all off by
one factor, and wrong matches are off by any (METHOD 22).

What the updates find |t_CF| to be off by is asked, too: a T_CF whose lengths change takes the map with it,
a little in each view, and always the same way.
"""

from __future__ import annotations

import numpy as np

from collabslam._core import SURE_LEVEL, chi2_quantile
from collabslam.types import Array

LEAST = 5
"""Fewest points of a view that say something together."""
_GATE = 3.0
"""Standard deviations within which two ratios are the same."""
_TIMES = 2.0
"""By how much more points must be at one other size than at the map's own."""
LAST_VIEWS, _LEAST_VIEWS = 7, 3
"""Views that together speak for a run: most of the last ones, that many at least."""
WINDOWS = (7, 15, 30)
"""Last views whose lengths are asked together: a change shows in few, one that creeps in many."""
CHANGES = (2, 4)
"""Last views whose lengths are held against those before."""
_LIMIT = chi2_quantile(1.0 - (1.0 - SURE_LEVEL) / (len(WINDOWS) + len(CHANGES)), 1)
"""Square, in variances, of what no length is off by."""
LEAST_TOLD = 0.1
"""Share of the variance of |t_CF| of which a view tells too little to count."""


def ask_size(ratio: Array, sd: Array) -> float:
    """How much a view contradicts the map's size; above 1 it does, NaN where it says nothing.

    Parameters
    ----------
    ratio : (N,) float64
        Logarithm of the distance of each point by the map over that by Cf.
    sd : (N,) float64
        Its standard deviation, by all that it may be off by.
    """
    same = np.abs(ratio) <= _GATE * sd
    others, spread = ratio[~same], sd[~same]
    together = np.abs(others - np.median(others)) <= _GATE * spread if len(others) else same[:0]
    as_claimed, otherwise = int(same.sum()), int(together.sum())
    if as_claimed + otherwise < LEAST:
        return float("nan")
    return otherwise / max(_TIMES * as_claimed, 1.0)


def contradicted_size(against: Array) -> bool:
    """Whether most of the last views that say something contradict the map's size.

    Parameters
    ----------
    against : (N,) float64
        As `ask_size` says of views, in their order.
    """
    told = against[~np.isnan(against)][-LAST_VIEWS:]
    return len(told) >= _LEAST_VIEWS and bool(np.mean(told > 1.0) > 0.5)


def changed_length(lengths: Array, time: float) -> float:
    """By how much |t_CF| has changed against the map, or that against it: of its logarithm, 0 for none.

    It has where it is off the same way in the last views, or off otherwise in them than in those before, more
    than errors within its covariance are.

    Parameters
    ----------
    lengths : (N, 6) float64
        Of each view: error of |t_CF| as the update finds it, in standard deviations; share of its variance
        that the update took away, which is the variance of the first number; what errors of the map that last
        add to that, which all views have in common; share of T_CF's own variance that lasts; its standard
        deviation over |t_CF|; its time, seconds.
    time : float
        How long what lasts of T_CF's error does, seconds (``filter.worn.bias_time``).
    """
    changes = [_off(lengths[-count:]) for count in WINDOWS if len(lengths) >= count]
    for count in CHANGES:
        before = lengths[-count - max(WINDOWS) : -count]
        if len(before) >= LEAST:
            changes.append(_otherwise(before, lengths[-count:], time))
    return max(changes, default=0.0)


def _off(views: Array) -> float:
    """By how much views are off together, if more than their errors allow."""
    error, told, of_map, lasting, sd, _ = views.T
    own = told.sum() * (1.0 + (len(error) - 1) * lasting.mean())
    allowed = own + np.sqrt(of_map).sum() ** 2
    return float(abs(error.sum()) / (told / sd).sum()) if error.sum() ** 2 > _LIMIT * allowed else 0.0


def _otherwise(before: Array, now: Array, time: float) -> float:
    """By how much views are off otherwise than those before, if more than their errors allow.

    What both have in common cancels; of what lasts, what has gone meanwhile is in the difference twice.
    """
    error, told, of_map, lasting, sd, at = now.T
    told_before, common = np.concatenate([told, before[:, 1]]).mean(), np.sqrt(of_map)
    gone = 1.0 - np.exp(-(at.mean() - before[:, 5].mean()) / time)
    own = told_before * (1.0 / len(now) + 1.0 / len(before) + 2.0 * lasting.mean() * gone)
    common_before = np.sqrt(before[:, 2]).mean()
    maps = (common.mean() - common_before) ** 2 + 2.0 * gone * common.mean() * common_before
    off = abs(error.mean() - before[:, 0].mean())
    return float(off / (told / sd).mean()) if off**2 > _LIMIT * (own + maps) else 0.0

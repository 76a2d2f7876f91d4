"""How the overlap of the two views is spread over time, and what it brings (Eq. 17-19)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from collabslam.errors import InputError
from collabslam.types import Array


def overlap_intervals(times: ArrayLike, overlap: ArrayLike) -> tuple[Array, Array]:
    """Durations of the intervals with overlap (eta) and without (mu), in order, seconds.

    A frame stands for the time up to the next one; the last one for the median of these.

    Parameters
    ----------
    times : (N,) array
        Seconds, increasing.
    overlap : (N,) array of bool
        Whether the views overlap in that frame.
    """
    t, on = np.asarray(times, np.float64), np.asarray(overlap, bool)
    if t.ndim != 1 or t.shape != on.shape:
        raise InputError(f"Times {t.shape} and overlap {on.shape} differ in shape; give two arrays (N,).")
    if len(t) < 2:
        return np.empty(0), np.empty(0)
    steps = np.diff(t)
    steps = np.append(steps, np.median(steps))
    edges = np.flatnonzero(np.diff(on.astype(int))) + 1
    durations = np.add.reduceat(steps, np.concatenate([[0], edges]))
    starts_on = on[np.concatenate([[0], edges])]
    return durations[starts_on], durations[~starts_on]


def overlap_ratio(times: ArrayLike, overlap: ArrayLike) -> float:
    """Share of the time with overlap; NaN for fewer than two frames."""
    eta, mu = overlap_intervals(times, overlap)
    total = eta.sum() + mu.sum()
    return float(eta.sum() / total) if total > 0.0 else float("nan")


def overlap_regularity(eta: ArrayLike) -> float:
    """Eq. 17: ``tau = N sum |eta_i - eta_total / N|``, seconds; NaN below two intervals."""
    durations = np.asarray(eta, np.float64)
    if len(durations) < 2:
        return float("nan")
    return float(len(durations) * np.abs(durations - durations.mean()).sum())


def non_overlap_deviation(mu: ArrayLike) -> float:
    """Eq. 18: ``kappa``, the variance of the intervals without overlap, s^2; NaN below two intervals."""
    durations = np.asarray(mu, np.float64)
    return float(durations.var()) if len(durations) > 1 else float("nan")


def overhead_return(position_error: ArrayLike, normaliser: float, eta_total: float) -> float:
    """Eq. 19: ``U = sum |r_i - r_hat_i|^2 eta_total / normaliser``, m s; less is better.

    Parameters
    ----------
    position_error : (N,) array
        Metres.
    normaliser : float
        Metres.  The paper's is ``|r_k - r_1|``, which vanishes on a loop; the path length does not.
    eta_total : float
        Time with overlap, seconds.

    Returns
    -------
    float
        NaN if the normaliser is zero.
    """
    if normaliser <= 0.0:
        return float("nan")
    return float((np.asarray(position_error, np.float64) ** 2).sum() * eta_total / normaliser)

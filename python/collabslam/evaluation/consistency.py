"""Whether a covariance tells the truth: normalised errors (NEES) and their chi-square bands."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from collabslam._core import chi2_quantile
from collabslam.bound import bounds
from collabslam.errors import InputError
from collabslam.evaluation.metrics import inverse
from collabslam.geometry import rotation_log
from collabslam.types import Array, Mask

RESOLUTION = 1e-6
"""Metres and radians below which no truth is taken to be known: its square is added to every variance."""

_FREEDOM = 4.0


def pose_tangent_error(estimate: ArrayLike, truth: ArrayLike) -> Array:
    """Tangent error ``xi`` with ``T_true = T_hat Exp(xi)`` (METHOD section 1), (N, 6) metres and radians.

    A pose with a NaN in it gives a row of NaN.
    """
    a, b = np.asarray(estimate, np.float64), np.asarray(truth, np.float64)
    if a.shape != b.shape or a.shape[1:] != (4, 4):
        raise InputError(
            f"Poses have the shapes {a.shape} and {b.shape}; give two arrays (N, 4, 4) of one length."
        )
    delta = inverse(a) @ b
    out = np.full((len(delta), 6), np.nan)
    for i in np.flatnonzero(np.isfinite(delta).all(axis=(1, 2))):
        out[i] = [*delta[i, :3, 3], *rotation_log(delta[i, :3, :3])]
    return out


def _paired(errors: ArrayLike, covariances: ArrayLike) -> tuple[Array, Array, Mask]:
    """Both as arrays, and in which rows they are finite."""
    e, p = np.asarray(errors, np.float64), np.asarray(covariances, np.float64)
    if e.ndim != 2 or p.shape != (*e.shape, e.shape[1]):
        raise InputError(f"Errors {e.shape} and covariances {p.shape} do not fit; give (N, d) and (N, d, d).")
    return e, p, np.asarray(np.isfinite(e).all(axis=1) & np.isfinite(p).all(axis=(1, 2)))


def nees(errors: ArrayLike, covariances: ArrayLike) -> Array:
    """Normalised estimation error squared ``e^T P^-1 e`` per row, (N,).

    Parameters
    ----------
    errors : (N, d) array
    covariances : (N, d, d) array
        `RESOLUTION` squared is added to the diagonal, so that a certain pose is not a division by zero.

    Returns
    -------
    (N,) array
        NaN where error or covariance is not finite.
    """
    e, p, good = _paired(errors, covariances)
    out = np.full(len(e), np.nan)
    if good.any():
        sound = p[good] + RESOLUTION**2 * np.eye(e.shape[1])
        out[good] = (e[good] * np.linalg.solve(sound, e[good][..., None])[..., 0]).sum(axis=1)
    return out


def sharpness(errors: ArrayLike, covariances: ArrayLike) -> float:
    """Root mean square error over the root mean square standard deviation that was claimed.

    expected 1, more is overconfident, less is overcautious.  Where NEES is a mean of ratios, this is a ratio
    of means: a covariance that is much too large in some poses cannot hide behind others.

    Parameters
    ----------
    errors : (N, d) array
    covariances : (N, d, d) array
        `RESOLUTION` squared is added to the diagonal.

    Returns
    -------
    float
        NaN if no row is finite.
    """
    e, p, good = _paired(errors, covariances)
    if not good.any():
        return float("nan")
    claimed = np.trace(p[good], axis1=1, axis2=2) + e.shape[1] * RESOLUTION**2
    return float(np.sqrt((e[good] ** 2).sum() / claimed.sum()))


def nees_band(dof: int, runs: int = 1, level: float = 0.95) -> tuple[float, float]:
    """Two-sided band in which the mean NEES of ``runs`` independent runs lies with probability ``level``.

    Frames of one run are correlated: a mean over the frames of a single run has no such band.
    """
    if dof < 1 or runs < 1:
        raise InputError(f"dof is {dof} and runs is {runs}; both must be 1 or more.")
    tail = 0.5 * (1.0 - level)
    low, high = (chi2_quantile(p, dof * runs) / runs for p in (tail, 1.0 - tail))
    return low, high


def sigma_gate(sigmas: float, dof: int) -> float:
    """Squared Mahalanobis distance in ``dof`` dimensions as unlikely as ``sigmas`` in one (two-sided).

    5 sigma has the tail 5.7e-7, which is 39.5 in six dimensions (and 25 in one).
    """
    tail = math.erfc(sigmas / math.sqrt(2.0))
    return chi2_quantile(1.0 - tail, dof)


def log_score(errors: ArrayLike, covariances: ArrayLike) -> float:
    """How likely errors are under their covariances, a mean of logarithms: higher is better.

    Too wide a covariance costs as too narrow a one does.  Each is taken for that of a Student's t of four
    degrees of freedom, so that few errors that no covariance foresees do not decide; a constant is left out.

    Parameters
    ----------
    errors : (N, d) array
    covariances : (N, d, d) array
        `RESOLUTION` squared is added to the diagonal.

    Returns
    -------
    float
        NaN if no row is finite.
    """
    squared, p = nees(errors, covariances), np.asarray(covariances, np.float64)
    good = np.isfinite(squared)
    if not good.any():
        return math.nan
    d = p.shape[1]
    _, volume = np.linalg.slogdet(p[good] + RESOLUTION**2 * np.eye(d))
    tails = (_FREEDOM + d) * np.log1p(squared[good] / (_FREEDOM - 2.0))
    return float(np.mean(-0.5 * (volume + tails)))


def bound_kept(errors: ArrayLike, covariances: ArrayLike) -> tuple[float, float, float]:
    """How poses keep to their bounds (`collabslam.bound`).

    Parameters
    ----------
    errors : (N, 6) array
        As of `pose_tangent_error`.
    covariances : (N, 6, 6) array

    Returns
    -------
    tuple of float
        Share of the poses whose position or attitude is further off than its bound, by more than
        `RESOLUTION`; root mean square bound over root mean square error of positions, and of attitudes.  NaN
        if no row is finite.
    """
    e, p, good = _paired(errors, covariances)
    if not good.any():
        return (math.nan, math.nan, math.nan)
    sizes = np.stack([np.linalg.norm(e[good, :3], axis=1), np.linalg.norm(e[good, 3:], axis=1)])
    told = np.stack(bounds(p[good]))
    exceeded = (sizes > told + RESOLUTION).any(axis=0)
    wider = np.sqrt((told**2).mean(axis=1) / np.maximum((sizes**2).mean(axis=1), RESOLUTION**2))
    return float(exceeded.mean()), float(wider[0]), float(wider[1])

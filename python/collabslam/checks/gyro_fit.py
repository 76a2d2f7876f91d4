"""How a gyroscope sits, and by what its clock is off, out of how the images turn (METHOD 28.4).

Between two frames the camera turned by a rotation vector v, along its own axes, and the samples say g along
theirs.  For the right clock v = s M g + b dt, with the mount M, the scale s and what the bias b adds: the
mount by Kabsch's method from all pairs, for each clock tried; the clock is the one that leaves least.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from collabslam._core import GYRO_GAP
from collabslam.checks.samples import lowest
from collabslam.geometry import rotation_exp
from collabslam.types import Array, ImuLog, Indices, Mask

REACH, STEP, FINE = 10.0, 0.04, 0.004
"""Seconds up to which a clock is sought, on a grid of that step, then of the finer one."""
_QUICK, _ITERATIONS = 2, 5
"""Fits on the first grid, and on the second: each weights the pairs by what the one before leaves of them."""
_FLOOR = 5e-4
"""Radians below which a residual is not weighted more."""
COVERED = 0.7
"""Share of the pairs that samples must cover for a clock to count."""
CLEAR = 0.7
"""Residual, as a share of another one's, from which on a fit is clearly better."""


class Turns(NamedTuple):
    """Pairs of frames: their times, (K,) seconds, and how the camera turned between them, (K, 3) rad.

    The rotation vectors are those of R_ab, which maps directions of the second into the first.
    """

    first: Array
    second: Array
    vectors: Array


class Fit(NamedTuple):
    """What samples and images say of each other for one clock.

    ``turn`` is orthogonal, (3, 3), and mirrors where the sensor's axes are left-handed; ``scale`` is what the
    rates are to be multiplied by, ``bias`` (3,) what they have too much, rad/s; ``left`` is the root mean
    square of the residuals, rad, and ``turned`` (3,) that of the turns about their own principal axes, the
    largest first, both of the pairs that fit.  ``information`` (4, 4) is of the three angles of the mount,
    along the camera's axes, and of the clock, per rad^2 of a residual's variance.
    """

    turn: Array
    scale: float
    bias: Array
    left: float
    turned: Array
    information: Array


class Integrated:
    """A gyroscope's rates, integrated once, to be asked for the turn between any two times.

    Parameters
    ----------
    log : ImuLog
    """

    def __init__(self, log: ImuLog) -> None:
        self._times, self._rates = log.times, log.rates
        steps = np.diff(log.times)
        self._gaps = np.concatenate([[0], np.cumsum(steps > GYRO_GAP)])
        angles = 0.5 * (log.rates[1:] + log.rates[:-1]) * steps[:, None]
        turns = [np.eye(3)]
        for angle in angles:
            turns.append(turns[-1] @ rotation_exp(angle))
        self._turns = np.asarray(turns)

    def between(self, first: Array, second: Array) -> tuple[Array, Array, Mask]:
        """Rotation vectors (K, 3) from times to others, by the sensor's clock, how they change with the clock
        (K, 3) rad/s, and which are known: not beyond the samples, nor over a gap of them."""
        inside = (first >= self._times[0]) & (second <= self._times[-1])
        (start, rate_a, gaps_a), (end, rate_b, gaps_b) = self._at(first, 0), self._at(second, 1)
        turns = np.swapaxes(start, 1, 2) @ end
        sines = 0.5 * (turns[:, [2, 0, 1], [1, 2, 0]] - turns[:, [1, 2, 0], [2, 0, 1]])
        sine, cosine = np.linalg.norm(sines, axis=1), 0.5 * (np.trace(turns, axis1=1, axis2=2) - 1.0)
        angle = np.arctan2(sine, cosine)
        vectors = sines * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 1e-9)[:, None]
        return vectors, rate_b - rate_a, inside & (gaps_a == gaps_b)

    def _at(self, t: Array, after: int) -> tuple[Array, Array, Indices]:
        """Attitudes (K, 3, 3) and rates (K, 3) at times, and how many gaps there are up to the sample before
        (0) or after (1) each."""
        k = np.clip(np.searchsorted(self._times, t, side="right") - 1, 0, len(self._times) - 2)
        since = (t - self._times[k])[:, None]
        share = since / (self._times[k + 1] - self._times[k])[:, None]
        rates = (1.0 - share) * self._rates[k] + share * self._rates[k + 1]
        x, y, z = (0.5 * (self._rates[k] + rates) * since).T
        zero = np.zeros_like(x)
        cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
        # To second order: between two samples the turn is small.
        turns = self._turns[k] @ (np.eye(3) + cross + 0.5 * cross @ cross)
        return turns, rates, self._gaps[k + after]


def best_fit(turns: Turns, log: ImuLog) -> tuple[float, Fit] | None:
    """The offset that is added to the samples' stamps for the clock of the frames, and what it leaves.

    None where no offset lets samples cover `COVERED` of the pairs.  A mount that mirrors is taken where it
    leaves clearly less (`CLEAR`).
    """
    integrated = Integrated(log)
    rough = log.sensor.time_offset + np.arange(-REACH, REACH + STEP, STEP)
    found = []
    for mirrored in (False, True):
        costs = [_left(fit_at(turns, integrated, float(o), mirrored=mirrored, fits=_QUICK)) for o in rough]
        best = float(rough[int(np.argmin(costs))])
        offsets = best + np.arange(-STEP, STEP + FINE, FINE)
        fine = [_left(fit_at(turns, integrated, float(o), mirrored=mirrored)) ** 2 for o in offsets]
        offset = lowest(offsets, np.array(fine), best)
        fit = fit_at(turns, integrated, offset, mirrored=mirrored)
        if fit is None:
            return None
        found.append((offset, fit))
    straight, turned = found
    return turned if turned[1].left < CLEAR * straight[1].left else straight


def fit_at(
    turns: Turns, integrated: Integrated, offset: float, *, mirrored: bool = False, fits: int = _ITERATIONS
) -> Fit | None:
    """What is left with one clock; None where too few pairs are covered."""
    g, changes, known = integrated.between(turns.first - offset, turns.second - offset)
    if int(known.sum()) < max(4.0, COVERED * len(known)):
        return None
    v, dt = turns.vectors[known], (turns.second - turns.first)[known]
    return _kabsch(v, g[known], changes[known], dt, -1.0 if mirrored else 1.0, fits)


def unexplained(off: Array, dt: Array) -> float:
    """What is left of differences of turns (K, 3), rad, over times ``dt``, but for what a bias explains."""
    weight = np.ones(len(off))
    for _ in range(_ITERATIONS):
        share = weight * dt / float(np.sum(weight * dt * dt))
        sizes = np.linalg.norm(off - np.outer(dt, share @ off), axis=1)
        weight = weights(sizes)
    return weighted_rms(sizes)


def weights(sizes: Array) -> Array:
    """Of residuals of these sizes: 1 up to their median, less beyond."""
    typical = max(_FLOOR, float(np.median(sizes)))
    return np.asarray(typical / np.maximum(sizes, typical))


def weighted_rms(sizes: Array) -> float:
    """Root mean square of residuals, weighted so."""
    weight = weights(sizes)
    return float(np.sqrt(np.sum(weight * sizes**2) / np.sum(weight)))


def _left(fit: Fit | None) -> float:
    return np.inf if fit is None else fit.left


def _kabsch(v: Array, g: Array, changes: Array, dt: Array, sign: float, fits: int) -> Fit:
    """Mount (of determinant ``sign``), scale and bias by least squares, misfits weighted less each time."""
    weight = np.ones(len(v))
    for _ in range(fits):
        share = weight * dt / float(np.sum(weight * dt * dt))
        lone_v, lone_g = v - np.outer(dt, share @ v), g - np.outer(dt, share @ g)
        u, size, vt = np.linalg.svd((weight[:, None] * lone_v).T @ lone_g)
        signs = np.array([1.0, 1.0, sign * np.sign(np.linalg.det(u) * np.linalg.det(vt))])
        turn = (u * signs) @ vt
        spread = float(np.sum(weight * np.sum(lone_g**2, axis=1)))
        scale = float(size @ signs) / spread if spread > 0.0 else 1.0
        residual = lone_v - scale * lone_g @ turn.T
        sizes = np.linalg.norm(residual, axis=1)
        weight = weights(sizes)
    bias = -turn.T @ (share @ (v - scale * g @ turn.T)) / scale
    left = weighted_rms(sizes)
    moved, late = scale * lone_g @ turn.T, scale * changes @ turn.T
    rows = np.stack([*(np.cross(axis, moved) for axis in np.eye(3)), -late], axis=2)
    information = np.einsum("nij,n,nik->jk", rows, weight, rows)
    scatter = np.einsum("ni,n,nj->ij", moved, weight, moved) / np.sum(weight)
    turned = np.sqrt(np.maximum(np.linalg.eigvalsh(scatter)[::-1], 0.0))
    return Fit(turn, scale, bias, left, turned, information)

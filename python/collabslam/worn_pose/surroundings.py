"""What stands still about the robot, and how the robot moves through it.

A grid of evidence rolls along with the robot: what a beam hits gains, what it passes loses. A beam that
meets nothing up to the scanner's limit opens places where nothing was, but takes nothing from a wall: dark
and slanting surfaces are not met either. A new scan, turned by the AHRS, is laid on the grid by Gauss-Newton
on the smoothed grid, for the translation alone, with a constant velocity as prior: where walls say nothing
(along a bare corridor) the prior decides, and its covariance grows. Only differences of positions a moment
apart are ever used, so drift does no harm.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from collabslam.types import Array, Mask

CELL = 0.1
"""Metres."""
_BITS = 8
_SIZE = 1 << _BITS
REACH = 0.45 * _SIZE * CELL
"""Distance from the robot up to which points count, metres."""
_CARVED, _SHARE = 9.0, 0.87
"""Rays carve up to this distance, metres, and this share of their length: the last part may graze a wall."""
_MOST, _LEAST, _HIT, _AMBIGUOUS, _PASSED = 4.0, -3.0, 0.5, 0.15, -0.5
_SOLID, _OPEN = 2.0, -1.0
_LINGERED, _STOOD = 0.8, 1.6
"""Seconds since something was first met in a cell: no foot rests so long, and nothing that walks at all.
Beams often miss a chair's leg, so that its cell looks open now and then."""
_ACCELERATION = 0.5
"""Density of the robot's acceleration, m/s^1.5."""
_MISFIT = 0.5
"""Standard deviation of a point's misfit to the grid."""
_LONGEST_GAP, _LONGEST_SEARCH = 0.7, 2.5
"""Seconds without scans after which the place is searched for, and after which that is given up."""
_SEARCHED, _UNIQUE, _RIVAL = 15, 3, 10.0
"""Cells to each side of the predicted position, cells within which everything as good as the best must lie,
and what counts as good: difference of log-likelihood."""
_MISSED = 16
"""Beams in turn that pass a place where something was: it has gone."""
_EMPTY = 4
"""Scans that found nothing at all beyond a cell, at most: each makes up for one beam that passed it."""

_SMOOTH = np.array([0.25, 0.5, 0.25], np.float32)
_NINE = np.ones((3, 3), np.uint8)
_RAY = np.arange(3.0, _CARVED / CELL, dtype=np.float32)
"""Cells from the scanner along a beam."""

Cells = NDArray[np.int64]


class Surroundings:
    """Evidence grid and motion of Cs, both in a frame with N's axes whose origin is where Cs started."""

    def __init__(self) -> None:
        self._evidence = np.zeros((_SIZE, _SIZE), np.float32)
        self._field = np.zeros(_SIZE * _SIZE, np.float32)
        self._solid = np.zeros(_SIZE * _SIZE, np.bool_)
        self._met = np.full((_SIZE, _SIZE), np.inf, np.float32)
        self._open = np.zeros(_SIZE * _SIZE, np.bool_)
        self._missed = np.zeros(_SIZE * _SIZE, np.int16)
        self._empty = np.zeros((_SIZE, _SIZE), np.int16)
        self._corner = np.zeros(2, np.int64)
        self._any = False
        self._since: float | None = None
        self._seen = -np.inf
        self.state = np.zeros(4)
        self._p = np.diag([1e-6, 1e-6, 0.5, 0.5])

    @property
    def position(self) -> Array:
        """(2,) of Cs, metres."""
        return self.state[:2]

    def predict(self, dt: float) -> None:
        """Carry the robot on for ``dt`` seconds."""
        f, q = _steady(round(dt * 1e6))
        self.state = f @ self.state
        self._p = f @ self._p @ f.T + q

    def align(self, t: float, points: Array) -> None:
        """Correct the robot's position by points (N, 2) seen from Cs, along N's axes."""
        gap, self._seen = t - self._seen, t
        if not self._any or not len(points):
            return
        start, prior = self.state[:2].copy(), np.linalg.inv(self._p[:2, :2])
        at = start.copy()
        if gap > _LONGEST_GAP:
            offset = self._search(points, prior) if gap < _LONGEST_SEARCH else None
            if offset is None:
                self._forget()
                return
            at += offset
        information = np.zeros((2, 2))
        for _ in range(3):
            value, slope = self._sample(points + at)
            information = (slope.T @ slope) / _MISFIT**2
            pull = slope.T @ (1.0 - value) / _MISFIT**2 - prior @ (at - start)
            step = np.linalg.solve(information + prior, pull)
            at += np.clip(step, -CELL, CELL)
            if abs(step).max() < 1e-3:
                break
        columns = self._p[:, :2]
        gain = columns @ np.linalg.solve(np.eye(2) + information @ self._p[:2, :2], information)
        self.state = self.state + columns @ prior @ (at - start)
        self._p = self._p - gain @ columns.T
        self._p = 0.5 * (self._p + self._p.T)

    def _search(self, points: Array, prior: Array) -> Array | None:
        """How far Cs is from where it was predicted, (2,) metres, to a cell; None if that is ambiguous."""
        cells = np.floor((points + self.state[:2]) / CELL).astype(np.int64)
        span = np.arange(-_SEARCHED, _SEARCHED + 1)
        shift = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2)
        i, j = ((cells[:, k] + shift[:, k, None]) & (_SIZE - 1) for k in (0, 1))
        misfit = ((1.0 - self._field[(i << _BITS) | j]) ** 2).sum(axis=1) / _MISFIT**2
        away = CELL * shift
        score = -0.5 * (misfit + ((away @ prior) * away).sum(axis=1))
        best = int(np.argmax(score))
        good = shift[score > score[best] - _RIVAL]
        if np.abs(good - shift[best]).max() > _UNIQUE or np.abs(shift[best]).max() == _SEARCHED:
            return None
        return np.asarray(away[best])

    def _forget(self) -> None:
        """Start anew: what was learnt before cannot be placed any more."""
        self._evidence[:] = 0.0
        self._met[:] = np.inf
        self._missed[:] = 0
        self._empty[:] = 0
        self._solid[:] = self._open[:] = False
        self._any, self._since = False, None

    def learn(
        self, t: float, origin: Array, points: Array, still: Mask, ambiguous: Mask, free: Array
    ) -> None:
        """Take a scan into the grid.

        Parameters
        ----------
        t : float
            Seconds.
        origin : (2,) array
            Of the scanner, in the grid's frame, metres.
        points : (N, 2) array
            Where its beams ended, in the grid's frame.
        still : (N,) bool
            Which of them may be surroundings: not the person.
        ambiguous : (N,) bool
            Which of them may be somebody's legs: they are learnt slowly, so that a foot that stands for
            half a second leaves no trace.
        free : (K, 2) array
            Rays from the scanner along which nothing was met, along the grid's axes, metres.
        """
        self._roll()
        rays = points - origin
        length = np.hypot(rays[:, 0], rays[:, 1])
        passed = _passed(origin, rays, length)
        near = length < REACH
        ended, still, ambiguous = _flat(points[near]), still[near], ambiguous[near]
        # Written once however often a cell is named; where a beam ends, nothing is lost.
        evidence = self._evidence.ravel()
        gained = evidence[ended] + np.where(still, np.where(ambiguous, _AMBIGUOUS, _HIT), 0.0)
        evidence[passed] = np.maximum(evidence[passed] + _PASSED, _LEAST)
        # What reflects too little, or at too flat an angle, is not met either: nothing that was met is lost.
        empty, beyond = self._empty.ravel(), _passed(origin, free, np.hypot(free[:, 0], free[:, 1]))
        empty[beyond] = np.minimum(empty[beyond] + 1, _EMPTY)
        evidence[ended] = np.minimum(gained, _MOST)
        if self._since is None:
            self._since = t
        self._missed[passed] += 1
        self._missed[ended] = 0
        met, legs = self._met.ravel(), ended[still & ambiguous]
        met[passed[self._missed[passed] > _MISSED]] = np.inf
        met[legs] = np.minimum(met[legs], t - self._since)
        self._refresh(t - self._since)

    def standing(self, points: Array) -> tuple[Mask, Mask]:
        """Of points (N, 2): whether something stands there that stood there before, and whether it is a place
        that beams went through before."""
        cells = _flat(points)
        return self._solid[cells], self._open[cells]

    def _roll(self) -> None:
        """Forget what is behind the horizon: its cells come to stand for what is ahead."""
        corner = np.floor(self.state[:2] / CELL).astype(np.int64) - _SIZE // 2
        if not self._any:
            self._corner, self._any = corner, True
        for axis, (old, new) in enumerate(zip(self._corner, corner, strict=True)):
            if new != old:
                fresh = np.arange(old, new) if new > old else np.arange(new, old)
                index = fresh[-_SIZE:] & (_SIZE - 1)
                lines = (index, slice(None)) if axis == 0 else (slice(None), index)
                self._evidence[lines] = 0.0
                self._met[lines] = np.inf
                self._missed.reshape(_SIZE, _SIZE)[lines] = 0
                self._empty[lines] = 0
        self._corner = corner

    def _refresh(self, now: float) -> None:
        self._solid = _grown((self._evidence >= _SOLID) | (self._met < now - _STOOD)).ravel()
        evidence = self._evidence + np.float32(_PASSED) * self._empty
        touched = _grown((evidence > 0.0) | (self._met < now - _LINGERED))
        self._open = ((evidence <= _OPEN) & ~touched & (now > _LINGERED)).ravel()
        field = np.maximum(self._evidence, 0.0) * np.float32(2.0 / _MOST)
        wide = cv2.copyMakeBorder(field, 1, 1, 1, 1, cv2.BORDER_WRAP)
        wide = cv2.sepFilter2D(wide, -1, _SMOOTH, _SMOOTH)
        self._field = np.minimum(wide[1:-1, 1:-1], 1.0).ravel()

    def _sample(self, points: Array) -> tuple[Array, Array]:
        """Smoothed grid (N,) and its slope (N, 2) per metre, between the cells' middles."""
        u = points / CELL - 0.5
        low = np.floor(u).astype(np.int64)
        f, g = (u - low).T
        i, j = low.T & (_SIZE - 1)
        i1, j1 = (i + 1) & (_SIZE - 1), (j + 1) & (_SIZE - 1)
        i, i1 = i << _BITS, i1 << _BITS
        a, b, c, d = self._field[i | j], self._field[i1 | j], self._field[i | j1], self._field[i1 | j1]
        value = (a * (1 - f) + b * f) * (1 - g) + (c * (1 - f) + d * f) * g
        slope = np.stack([(b - a) * (1 - g) + (d - c) * g, (c - a) * (1 - f) + (d - b) * f], axis=1)
        return value, slope / CELL


@lru_cache(maxsize=256)
def _steady(microseconds: int) -> tuple[Array, Array]:
    """Transition and noise (4, 4) of a constant velocity."""
    dt, q = 1e-6 * microseconds, _ACCELERATION**2
    step = np.array([[1.0, dt], [0.0, 1.0]])
    noise = q * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    return np.asarray(np.kron(step, np.eye(2))), np.asarray(np.kron(noise, np.eye(2)))


def _grown(cells: Mask) -> Mask:
    """Cells and their eight neighbours."""
    wide = cv2.copyMakeBorder(cells.view(np.uint8), 1, 1, 1, 1, cv2.BORDER_WRAP)
    return np.asarray(cv2.dilate(wide, _NINE)[1:-1, 1:-1] > 0)


def _passed(origin: Array, rays: Array, length: Array) -> Cells:
    """Cells that rays (N, 2) of these lengths from a scanner pass, each as often as it is passed."""
    step = (rays / length[:, None]).astype(np.float32)
    inside = _RAY[:, None] * CELL < _SHARE * length - CELL
    x = (np.float32(origin[0] / CELL) + _RAY[:, None] * step[:, 0])[inside]
    y = (np.float32(origin[1] / CELL) + _RAY[:, None] * step[:, 1])[inside]
    i, j = (np.floor(v).astype(np.int32) & (_SIZE - 1) for v in (x, y))
    return np.asarray((i << _BITS) | j)


def _flat(points: Array) -> Cells:
    """Index of the cells that points (..., 2) lie in; the grid repeats itself."""
    cells = np.floor(points * (1.0 / CELL)).astype(np.int64) & (_SIZE - 1)
    return np.asarray((cells[..., 0] << _BITS) | cells[..., 1])

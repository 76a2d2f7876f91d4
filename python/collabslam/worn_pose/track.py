"""A person on two legs, tracked by probabilistic data association.

State: position p and velocity v of the trunk over the floor, and the swing g of the middle of both shins
about the trunk with its rate, which a gait makes anything but white: a damped oscillator at the frequency of
steps, driven by white noise. A scan shows p + g, by a pair of leg-like things, by one wide one, by one leg
alone, or not at all; every such reading that passes the gate is a hypothesis, weighed by its likelihood
against clutter and against other people, and the posterior is the moment-matched mixture: ambiguity between
readings shows in the covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from math import cos, exp, hypot, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from collabslam.types import Array, Indices, Mask
from collabslam.worn_pose.config import Person

_GATE = 16.0
_PAIR, _WIDE, _ONE, UNSEEN = 0.6, 0.35, 0.3, 0.05
"""Prior weights of how a person shows."""
_PEOPLE = 0.02
"""Other people per square metre, as long as nobody else is known of."""
_NEAREST_LEGS, _FARTHEST_LEGS = 0.10, 0.65
_START_SPEED = 0.8
_WIDE_SD = 0.05
_NONE_AFTER = 0.5
"""The same once the person was hidden."""
_HIDDEN = 0.3
"""Seconds without legs from which the person counts as hidden."""
_SEEN = 0.5
_MOVING_TIME, _WALKED, _STANDING = 0.5, 0.75, 0.05
"""Memory, in seconds, of whether the legs are where beams went through before, and its levels."""
_SURE = 0.5
"""Probability, from one scan, of legs where beams went through before: somebody was there then."""
_MEMORY = 0.1
_DAMPING = 0.2
"""Of the swing: cadence and gait are not known, and change."""
_PACE = 1.3
"""Speed, in m/s, up to which `Person.acceleration_density` holds, and at which `Person.gait_sd` is stated."""
_ASIDE = 0.2
"""Swing across the way, as a share of that along it."""
_ONE_LEG_TIME = 0.3
"""Time constant, in seconds, of the error that readings of one leg share; as white noise they get its
spectral density: twice that time."""


@dataclass(frozen=True)
class Candidates:
    """Leg-like things that are not surroundings.

    Attributes
    ----------
    centre : (n, 2) array
        Metres.
    covariance : (n, 2, 2) array
    wide : (n,) bool
    clutter : (n,) array
        Density of things that look so and are not legs, per square metre.
    moving : (n,) bool
        Where nothing stood before.
    """

    centre: Array
    covariance: Array
    wide: Mask
    clutter: Array
    moving: Mask

    def __len__(self) -> int:
        return len(self.centre)

    def some(self, index: Indices) -> Candidates:
        """These candidates, in this order."""
        return Candidates(*(getattr(self, f.name)[index] for f in fields(self)))


class Readings(NamedTuple):
    """What candidates may show of a person.

    Attributes
    ----------
    z : (h, 2) array
        Metres.
    spread : (h, 2, 2) array
        Covariance.
    swing : (h,) array
        Variance of what gait adds to a reading of less than two legs.
    weight : (h,) array
        Likelihood ratios to nothing but clutter.
    moving : (h,) array
        Which share of it moves.
    """

    z: Array
    spread: Array
    swing: Array
    weight: Array
    moving: Array


class LegTrack:
    """One person.

    Parameters
    ----------
    t : float
        Seconds.
    at : (2,) array
        Metres.
    covariance : (2, 2) array
        Of ``at``.
    person : Person

    Attributes
    ----------
    robot : (2,) array
        Where the robot was when the track began, metres.
    met, sure : tuple of float and (2,) array
        When and where this was last seen, and last seen to be somebody, not furniture: seconds, metres.
    """

    def __init__(self, t: float, at: Array, covariance: Array, person: Person) -> None:
        self._person = person
        self.x = np.concatenate([at, np.zeros(6)])
        self.p = np.zeros((8, 8))
        self.p[:2, :2] = covariance + person.gait_sd**2 * np.eye(2)
        self.p[[2, 3], [2, 3]] = _START_SPEED**2
        self.p[[4, 5], [4, 5]] = person.gait_sd**2
        self.p[[6, 7], [6, 7]] = (2.0 * np.pi * person.step_rate * person.gait_sd) ** 2
        # The swing was part of what was seen first.
        self.p[[0, 1, 4, 5], [4, 5, 0, 1]] = -(person.gait_sd**2)
        self.born, self._updated, self._read = t, t, t
        self.start = self.x[:2].copy()
        self.robot = self.start
        self.stranger = False
        self.met = self.sure = (t, self.start)
        self.quality = 0.5
        self.moving = 0.5
        self.walked = False

    @property
    def seen(self) -> float:
        """When this was last seen, seconds."""
        return self.met[0]

    @property
    def position_sd(self) -> float:
        """Along the worst axis, metres."""
        a, b, c = self.p[0, 0], self.p[1, 1], self.p[0, 1]
        return float(np.sqrt(0.5 * (a + b) + np.hypot(0.5 * (a - b), c)))

    def predict(self, dt: float, jitter: float) -> None:
        """Carry on for ``dt`` seconds; ``jitter`` (m^2) is what the robot's heading adds meanwhile."""
        self.x, self.p = carried(self.x, self.p, dt, jitter, self._person)

    def density(self, points: Array) -> Array:
        """Expected number of this person's legs per square metre at points (n, 2)."""
        s = self.p[:2, :2] + self._person.one_leg_sd**2 * np.eye(2)
        d = points - self.x[:2]
        mahalanobis = (d * np.linalg.solve(s, d.T).T).sum(axis=1)
        return np.asarray(2.0 * np.exp(-0.5 * mahalanobis) / (2.0 * np.pi * np.sqrt(np.linalg.det(s))))

    def update(self, t: float, c: Candidates, noise: float, elsewhere: Array, *, in_view: bool) -> None:
        """Take the candidates of a scan.

        Parameters
        ----------
        t : float
            Seconds.
        c : Candidates
        noise : float
            Further variance of their positions, m^2: heading and motion of the robot.
        elsewhere : (n,) array
            Density of other people's legs at each candidate, per square metre.
        in_view : bool
            Whether the person should be where the scanner looks.
        """
        dt = max(t - self._updated, 5e-3)
        self._updated = t
        hidden = t - self.seen > _HIDDEN
        seen = 0.0
        hypotheses = self._hypotheses(c, noise, elsewhere, hidden) if len(c) else None
        if hypotheses is not None:
            z, spread, swing, weight, moving = hypotheses
            # A scanner that looks elsewhere takes nothing of what one leg says.
            alone, self._read = max(t - self._read, 5e-3), t
            total = (UNSEEN if in_view and not hidden else _NONE_AFTER) + weight.sum()
            seen = float(weight.sum() / total)
            self._mix(z, spread, swing * max(1.0, 2.0 * _ONE_LEG_TIME / alone), weight / total)
            share = float(weight @ moving / total)
            if share > _SURE:
                self.sure = (t, self.x[:2].copy())
            self.moving += min(dt / _MOVING_TIME, 1.0) * (share - seen * self.moving)
            self.walked |= self.moving > _WALKED
        if seen > _SEEN:
            self.met = (t, self.x[:2].copy())
        if in_view or seen > _SEEN:
            self.quality += _MEMORY * (seen - self.quality)

    @property
    def ambiguous(self) -> bool:
        """Whether what is tracked has stood for long where beams never went through: furniture."""
        return self.walked and self.moving < _STANDING

    def readings(self, c: Candidates) -> Readings | None:
        """What the candidates may show of this person if nobody else is there; None without any."""
        return self._hypotheses(c, 0.0, np.zeros(len(c)), hidden=False)

    def _hypotheses(self, c: Candidates, noise: float, elsewhere: Array, hidden: bool) -> Readings | None:
        """Readings that pass the gate.  A person who was hidden comes back as something that moves."""
        person = self._person
        pzz = self.p[:2, :2] + self.p[4:6, 4:6] + self.p[:2, 4:6] + self.p[4:6, :2]
        reach = 4.0 * np.sqrt(max(pzz[0, 0], pzz[1, 1])) + 0.5
        d = c.centre - self.x[:2] - self.x[4:6]
        near = np.flatnonzero(np.hypot(d[:, 0], d[:, 1]) < reach)
        if not len(near):
            return None
        centre, cov, wide = c.centre[near], c.covariance[near], c.wide[near]
        clutter = c.clutter[near] + elsewhere[near]
        moves = c.moving[near].astype(np.float64)
        single = np.where(wide, _WIDE_SD, person.one_leg_sd) ** 2
        i, j = np.triu_indices(len(near), 1)
        gap = np.hypot(*(centre[i] - centre[j]).T)
        legs = ~wide[i] & ~wide[j] & (gap > _NEAREST_LEGS) & (gap < _FARTHEST_LEGS)
        i, j = i[legs], j[legs]
        z = np.concatenate([centre, 0.5 * (centre[i] + centre[j])])
        spread = np.concatenate([cov, 0.25 * (cov[i] + cov[j])]) + noise * np.eye(2)
        swing = np.concatenate([single, np.zeros(len(i))])
        apart = 1.0 / (np.pi * (_FARTHEST_LEGS**2 - _NEAREST_LEGS**2))
        prior = np.concatenate([np.where(wide, _WIDE, _ONE), np.full(len(i), _PAIR * apart)])
        # Somebody not known of shows in the same ways.
        prior /= np.concatenate([clutter, clutter[i] * clutter[j]]) + _PEOPLE * prior
        moving = np.concatenate([moves, 0.5 * (moves[i] + moves[j])])
        s = pzz + spread + swing[:, None, None] * np.eye(2)
        innovation = z - self.x[:2] - self.x[4:6]
        det = s[:, 0, 0] * s[:, 1, 1] - s[:, 0, 1] ** 2
        a, b = innovation.T
        distance = (s[:, 1, 1] * a * a - 2.0 * s[:, 0, 1] * a * b + s[:, 0, 0] * b * b) / det
        inside = (distance < _GATE) & ((moving > 0.0) | (not hidden))
        if not inside.any():
            return None
        weight = prior * np.exp(-0.5 * distance) / (2.0 * np.pi * np.sqrt(det))
        return Readings(z[inside], spread[inside], swing[inside], weight[inside], moving[inside])

    def _mix(self, z: Array, spread: Array, swing: Array, w: Array) -> None:
        """Moment-matched mixture of the updates by each reading, of probability ``w``, and of none."""
        cross = self.p[:, :2] + self.p[:, 4:6]
        pzz = cross[:2] + cross[4:6]
        s = pzz + spread + swing[:, None, None] * np.eye(2)
        gain = cross @ np.linalg.inv(s)
        moved = (gain @ (z - self.x[:2] - self.x[4:6])[:, :, None])[:, :, 0]
        mean = w @ moved
        shrunk = np.tensordot(w, gain @ cross.T, axes=1)
        apart = (moved * w[:, None]).T @ moved - np.outer(mean, mean)
        self.x = self.x + mean
        p = self.p - shrunk + apart
        self.p = 0.5 * (p + p.T)


def carried(x: Array, p: Array, dt: float, jitter: float, person: Person) -> tuple[Array, Array]:
    """State and covariance ``dt`` seconds later.

    Who turns with a radius r at a speed v changes the velocity by about v in a time r / v, so that the
    density of the acceleration grows as v^1.5.
    """
    f, walk, swing = _motion(round(dt * 1e6), person)
    speed = hypot(x[2], x[3])
    out = f @ p @ f.T
    out[:4, :4] += max(1.0, speed / _PACE) ** 3 * walk
    # The shins swing along the way, the more the longer the steps.
    along = min(speed / _PACE, 1.5) / max(speed, 1e-9) * x[2:4]
    out[4:, 4:] += np.kron(swing, np.outer(along, along) + _ASIDE**2 * np.eye(2))
    out[0, 0] += jitter
    out[1, 1] += jitter
    return f @ x, out


@lru_cache(maxsize=256)
def _motion(microseconds: int, person: Person) -> tuple[Array, Array, Array]:
    """Transition (8, 8) of walk and swing, noise (4, 4) of the walk, (2, 2) of the swing along an axis."""
    dt = 1e-6 * microseconds
    w = 2.0 * pi * person.step_rate
    decay, turn = exp(-_DAMPING * w * dt), w * sqrt(1.0 - _DAMPING**2)
    c, s = decay * cos(turn * dt), decay * sin(turn * dt) / turn
    swing = np.array([[c + _DAMPING * w * s, s], [-w * w * s, c - _DAMPING * w * s]])
    stationary = person.gait_sd**2 * np.diag([1.0, w * w])
    q = person.acceleration_density**2
    f = np.zeros((4, 4))
    f[:2, :2] = [[1.0, dt], [0.0, 1.0]]
    f[2:, 2:] = swing
    walk = q * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    one = np.eye(2)
    return (
        np.asarray(np.kron(f, one)),
        np.asarray(np.kron(walk, one)),
        stationary - swing @ stationary @ swing.T,
    )


def new_track(t: float, c: Candidates, which: Mask, person: Person) -> LegTrack | None:
    """A track from some of the candidates: the first two legs or wide thing among them, else the first leg.

    Who comes straight on hides one leg behind the other.  None without candidates.
    """
    index = np.flatnonzero(which)
    for a in range(len(index)):
        i = index[a]
        if c.wide[i]:
            return LegTrack(t, c.centre[i], c.covariance[i] + _WIDE_SD**2 * np.eye(2), person)
        for j in index[a + 1 :]:
            gap = float(np.hypot(*(c.centre[i] - c.centre[j])))
            if not c.wide[j] and _NEAREST_LEGS < gap < _FARTHEST_LEGS:
                middle = 0.5 * (c.centre[i] + c.centre[j])
                return LegTrack(t, middle, 0.25 * (c.covariance[i] + c.covariance[j]), person)
    if not len(index):
        return None
    i = index[0]
    return LegTrack(t, c.centre[i], c.covariance[i] + person.one_leg_sd**2 * np.eye(2), person)

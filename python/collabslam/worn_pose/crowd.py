"""Everybody on legs about the robot, and which of them wears the camera."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from collabslam.types import Array, Mask
from collabslam.worn_pose.config import WornPoseConfig
from collabslam.worn_pose.track import UNSEEN, Candidates, LegTrack, new_track

_MOST_OTHERS = 3
_CONFIRM_TIME, _CONFIRM_QUALITY, _CONFIRM_WAY, _CONFIRM_SPEED = 1.3, 0.8, 0.5, 0.25
_CONFIRM_MOVING, _CONFIRM_SOON = 0.6, 0.7
_COMPANY_SPEED, _PARTING_SPEED = 1.3, 0.6
"""Metres a second by which the velocity of somebody who comes along differs from the robot's at most (now,
and on average: a passer-by may stop), and by which the distance between the two changes."""
_COMPANY = 5.0
"""Metres from the robot within which a person is first looked for."""
_HINT_REACH, _HINT_SD, _HINT_WAIT = 0.8, 0.25, 0.5
"""Metres from where the person was said to start up to which things are not surroundings, how far from there
they are, and seconds after which one leg will do."""
_DROP_TIME, _KEEP_TIME = 0.3, 1.5
_REACH_AT_ONCE, _WALK = 1.0, 2.0
"""Metres from where the person was last seen, and metres a second since (faster than anybody walks), within
which somebody is the person."""
_LEFT = 1.5
"""Metres that the robot goes on until what has stayed where it was said to be is furniture."""
_OWN_LEGS, _SAME = 0.35, 0.15
"""Metres from somebody up to which leg-like things are their own legs, and the middle of two is theirs."""
_SURE = 0.95
"""Probability of the reading of where the person was said to start from which it is the person."""
_BESIDE_SD, _HALF = 0.1, 0.1
"""Metres that a thing beside the person seems to move at first, and by which the trunk of somebody of whom both
legs are seen differs from what is seen at most."""
_DECISIVE = 3.0
"""Logarithm of the odds from which one of two readings is the right one."""
_STRANGER_SD, _LOST_SD = 0.5, 0.8
_SEEN_BACK, _TRIAL = 0.4, 2.0
"""Seconds in which a new track must have walked."""

View = Callable[[Array], bool]


class Crowd:
    """Tracks of people.

    Attributes
    ----------
    person : LegTrack or None
        Who wears the camera, as far as is known.
    sure : bool
        Whether that is beyond doubt: nothing else was near where they were said to start, or they walk.
    others : list of LegTrack
    lost : tuple of float and (2,) array, or None
        When and where the person was last: seconds, metres.
    """

    def __init__(self, config: WornPoseConfig) -> None:
        self._config = config
        self._hint = config.start
        self.person: LegTrack | None = None
        self.sure = False
        self.others: list[LegTrack] = []
        self.lost: tuple[float, Array] | None = None
        self._began = np.inf
        self._origin: Array | None = None
        self._told: tuple[float, Array] | None = None
        self._ambiguous = False
        self._beside = np.zeros((0, 2))
        self._back: tuple[float, Array] | None = None

    def predict(self, dt: float, robot: Array, drift: float) -> None:
        """Carry everybody on; ``drift`` (rad^2/s) is how fast the robot's heading error changes."""
        for track in self._all():
            away = track.x[:2] - robot
            track.predict(dt, drift * dt * float(away @ away))

    def update(
        self,
        t: float,
        c: Candidates,
        robot: Array,
        motion: Array,
        heading: float,
        hint: Array | None,
        view: View,
    ) -> None:
        """Take the candidates of a scan.

        Parameters
        ----------
        t : float
            Seconds.
        c : Candidates
        robot : (2,) array
            Position of Cs.
        motion : (2,) array
            Its velocity, m/s.
        heading : float
            Variance of the white part of its heading, rad^2.
        hint : (2,) array or None
            Where the person was said to start.
        view : callable
            Whether the scanner looks at a place.
        """
        self._began = min(self._began, t)
        if self._origin is None:
            self._origin = robot.copy()
            self._told = None if hint is None else (t, hint)
        if float(np.hypot(*(robot - self._origin))) > _LEFT:  # nobody who comes along is still there
            self._hint = None
        tracks = self._all()
        densities = [track.density(c.centre) for track in tracks]
        whole = sum(densities, np.zeros(len(c)))
        person = self.person
        if person is not None and t - person.born < _TRIAL:
            whole = whole + _legs_at(self._beside, c.centre)
        before = None if self.person is None else (self.person.x[:2].copy(), self.person.p[:2, :2].copy())
        vague = self.person is not None and self.person.position_sd > self._config.max_position_sd
        for track, own in zip(tracks, densities, strict=True):
            away = track.x[:2] - robot
            noise = heading * float(away @ away) + 0.01**2
            track.update(t, c, noise, whole - own, in_view=view(track.x[:2]))
        if vague and before is not None and self.person is not None and self.person.seen == t:
            self._ambiguous = _rivalled(self.person.x[:2], *before, c)
            self._back = (t, self.person.x[:2] - robot)
        self._ambiguous |= self._parts(t, robot, motion)
        self._retire(t, robot)
        self._begin(t, c, robot, hint, view)
        self._recruit(t, c, robot)
        self._choose(t, robot, motion)

    def claimed(self, points: Array, hint: Array | None) -> Mask:
        """Which of points (n, 2) may be somebody's legs, so that they are not surroundings.

        Also those about where the person was said to start, ``hint``, until somebody is found there.
        """
        out = np.zeros(len(points), np.bool_)
        if self._hint is not None and hint is not None:
            out |= np.hypot(*(points - hint).T) < _HINT_REACH
        for track in self._all():
            if self.sure if track is self.person else _walks(track):
                d = points - track.x[:2]
                out |= (d * d).sum(axis=1) < (0.4 + min(track.position_sd, 0.3)) ** 2
        return out

    def _all(self) -> list[LegTrack]:
        return self.others if self.person is None else [self.person, *self.others]

    def _retire(self, t: float, robot: Array) -> None:
        limit = self._config
        person = self.person
        if person is not None:
            known = _known(person, robot)
            if known is not None or self._ambiguous or (
                t - person.seen > limit.max_gap or person.position_sd > max(limit.max_position_sd, _LOST_SD)
            ):
                if person.walked:
                    self.lost = known or person.met
                    # Was there beside the person, so is somebody else; what was followed since may be anything.
                    until = min(self.lost[0], person.sure[0])
                    for other in self.others:
                        other.stranger |= other.born < until
                self.person, self.sure, self._ambiguous, self._back = None, False, False, None
        self.others = [
            o
            for o in self.others
            if t - o.seen <= (_KEEP_TIME if _walks(o) else _DROP_TIME)
            and (_walks(o) or t - o.born < _TRIAL)
            and o.position_sd < _STRANGER_SD
            and not o.doubtful
            and not self._same(o)
        ]

    def _parts(self, t: float, robot: Array, motion: Array) -> bool:
        """Whether who came back just now goes against the robot's way, as a passer-by does."""
        if self.person is None or self._back is None or not _SEEN_BACK < t - self._back[0] < _TRIAL:
            return False
        since, place = self._back
        apart = float(np.hypot(*(self.person.x[:2] - robot - place)))
        return apart > _COMPANY_SPEED * (t - since) and float(self.person.x[2:4] @ motion) < 0.0

    def _same(self, other: LegTrack) -> bool:
        """Whether a track has fallen together with the person's, or an older one."""
        for track in self._all():
            if track is other:
                return False
            if float(np.hypot(*(track.x[:2] - other.x[:2]))) < 0.2:
                return True
        return False

    def _begin(self, t: float, c: Candidates, robot: Array, hint: Array | None, view: View) -> None:
        """Take the likeliest reading of where the person was said to start; what else is there is not theirs."""
        if self._hint is None or hint is None or self.person is not None or not len(c) or not view(hint):
            return
        told = LegTrack(t, hint, _HINT_SD**2 * np.eye(2), self._config.person).readings(c)
        if told is None:
            return
        best = int(np.argmax(told.weight))
        if told.swing[best] > _HALF**2 and t - self._began < _HINT_WAIT:  # one leg may hide the other for a moment
            return
        at = told.z[best]
        covariance = told.spread[best] + told.swing[best] * np.eye(2)
        self.person, self._hint = LegTrack(t, at, covariance, self._config.person), None
        self.person.robot = robot.copy()
        own = np.hypot(*(told.z - at).T) < np.where(told.swing > _HALF**2, _OWN_LEGS, _SAME)
        self.sure = bool(told.weight[own].sum() > _SURE * (UNSEEN + told.weight.sum()))
        self._beside = c.centre[np.hypot(*(c.centre - at).T) > _OWN_LEGS]

    def _recruit(self, t: float, c: Candidates, robot: Array) -> None:
        """Follow one more of those who walk about the robot."""
        if not len(c) or len(self.others) >= _MOST_OTHERS:
            return
        free = np.hypot(*(c.centre - robot).T) < _COMPANY
        for track in self._all():
            d = c.centre - track.x[:2]
            reach = 0.6 + 2.0 * track.position_sd
            free &= (d * d).sum(axis=1) > reach**2
        found = new_track(t, c, free & c.moving, self._config.person)
        if found is None:
            return
        found.robot = robot.copy()
        place = self._place()
        if place is not None:
            found.stranger = float(np.hypot(*(found.start - place[1]))) > _reach(t - place[0])
        self.others.append(found)

    def _place(self) -> tuple[float, Array] | None:
        """When and where the person was last known to be; None if nothing was ever known."""
        if self.person is not None and self.person.walked:
            return self.person.met
        return self._told if self.lost is None else self.lost

    def _choose(self, t: float, robot: Array, motion: Array) -> None:
        """Whoever walks along, nearest to the robot; after a loss only somebody who can have come there."""
        if self.person is not None:
            self.sure = self.sure or self.person.walked
            if self.person.walked:
                return
        known = self._place()
        place = robot if known is None else known[1]
        able = [o for o in self.others if o.walked and not o.stranger and _accompanies(o, t, robot, motion)]
        if able:
            best = min(able, key=lambda o: float(np.hypot(*(o.x[:2] - place))))
            if _confirmed(best, t, _CONFIRM_TIME if known is None or len(able) > 1 else _CONFIRM_SOON):
                self.others.remove(best)
                self.person, self.sure = best, True


def _rivalled(at: Array, expected: Array, covariance: Array, c: Candidates) -> bool:
    """Whether something else than what was taken for a person, hidden before, may as well be that person.

    Parameters
    ----------
    at : (2,) array
        Where the person now seems to be, metres.
    expected, covariance : (2,), (2, 2) array
        Where they were expected.
    c : Candidates
    """
    d = np.vstack([at, c.centre]) - expected
    mahalanobis = (d * np.linalg.solve(covariance, d.T).T).sum(axis=1)
    own = np.hypot(*(c.centre - at).T) < _OWN_LEGS
    clutter = c.clutter[own].min() if own.any() else c.clutter.min()
    odds = 0.5 * (mahalanobis[0] - mahalanobis[1:]) + np.log(clutter / c.clutter)
    return bool((odds[~own] > -_DECISIVE).any())


def _legs_at(places: Array, points: Array) -> Array:
    """Density (n,) per square metre at points (n, 2) of things that stand at places (m, 2)."""
    d = points[:, None] - places
    near = np.exp(-0.5 * (d * d).sum(axis=2) / _BESIDE_SD**2).sum(axis=1)
    return np.asarray(near / (2.0 * np.pi * _BESIDE_SD**2))


def _reach(seconds: float) -> float:
    """How far somebody can have come, metres."""
    return _REACH_AT_ONCE + _WALK * seconds


def _accompanies(track: LegTrack, t: float, robot: Array, motion: Array) -> bool:
    """Whether somebody keeps up with the robot, other than who comes towards it or stays behind."""
    age, before, now = t - track.born, track.start - track.robot, track.x[:2] - robot
    change = abs(float(np.hypot(*now) - np.hypot(*before)))
    apart = max(float(np.hypot(*(track.x[2:4] - motion))), float(np.hypot(*(now - before))) / max(age, 1e-3))
    return apart < _COMPANY_SPEED and change < _PARTING_SPEED * age


def _walks(track: LegTrack) -> bool:
    """Whether a track has left the place where it began."""
    return float(np.hypot(*(track.x[:2] - track.start))) >= _CONFIRM_WAY


def _known(track: LegTrack, robot: Array) -> tuple[float, Array] | None:
    """When and where somebody was there, if what is followed now is furniture; None if it is not."""
    if not _walks(track) and float(np.hypot(*(robot - track.robot))) > _LEFT:
        return track.born, track.start
    return track.sure if track.doubtful else None


def _confirmed(track: LegTrack, t: float, least: float) -> bool:
    """Whether a track is a person beyond doubt: seen for a while, and walking."""
    age = t - track.born
    way = float(np.hypot(*(track.x[:2] - track.start)))
    return (
        age >= least
        and track.quality >= _CONFIRM_QUALITY
        and track.moving >= _CONFIRM_MOVING
        and way >= max(_CONFIRM_WAY, min(age, _TRIAL) * _CONFIRM_SPEED)
    )

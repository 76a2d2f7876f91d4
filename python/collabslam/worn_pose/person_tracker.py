"""Everybody on legs about the robot, and which of them wears the camera."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from collabslam.types import Array, Mask
from collabslam.worn_pose.config import WornPoseConfig
from collabslam.worn_pose.evidence import (
    COMPANY_SPEED,
    CONFIRM_SOON,
    CONFIRM_TIME,
    LEFT,
    OWN_LEGS,
    TRIAL,
    accompanies,
    confirmed,
    known_before,
    legs_at,
    may_walk,
    rivalled,
    walks,
)
from collabslam.worn_pose.track import UNSEEN, Candidates, LegTrack, new_track

_MOST_OTHERS = 6
_COMPANY = 5.0
"""Metres from the robot within which a person is first looked for."""
_HINT_REACH, _HINT_SD, _HINT_WAIT = 0.8, 0.25, 0.5
"""Metres from where the person was said to start up to which things are not surroundings, how far from there
they are, and seconds after which one leg will do."""
_DROP_TIME, _KEEP_TIME = 0.3, 1.5
_REACH_AT_ONCE, _WALK = 1.0, 2.0
"""Metres from where the person was last seen, and metres a second since (faster than anybody walks), within
which somebody is the person."""
_SAME = 0.15
"""Metres from somebody up to which the middle of two legs is theirs."""
_SURE = 0.95
"""Probability of the reading of where the person was said to start from which it is the person."""
_HALF = 0.1
"""Metres of spread of the trunk about a reading from which one leg was read."""
_STRANGER_SD, _LOST_SD = 0.5, 0.8
"""Metres to which others, and the person, must be known to be followed; a pose needs more."""
_SEEN_BACK = 0.4
"""Seconds after which it shows where somebody who is back goes."""

View = Callable[[Array], bool]


class PersonTracker:
    """Tracks of people.

    Attributes
    ----------
    person : LegTrack or None
        Who wears the camera, as far as is known.
    sure : bool
        Whether that is for certain: nothing else was near where they were said to start, or they walk.
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
        self._beside = np.zeros((0, 2))
        self._back: tuple[float, Array, tuple[float, Array]] | None = None

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
        if float(np.hypot(*(robot - self._origin))) > LEFT:  # nobody who comes along is still there
            self._hint = None
        contradicted = self._follow(t, c, robot, heading, view) or self._parts(t, robot, motion)
        self._retire(t, robot, contradicted)
        self._begin(t, c, robot, hint, view)
        self._recruit(t, c, robot)
        self._choose(t, robot, motion)

    def _follow(self, t: float, c: Candidates, robot: Array, heading: float, view: View) -> bool:
        """Update every track; whether a person hidden before may as well be something else that is seen."""
        tracks, person = self._all(), self.person
        densities = [track.density(c.centre) for track in tracks]
        whole = sum(densities, np.zeros(len(c)))
        if person is not None and t - person.born < TRIAL:
            whole = whole + legs_at(self._beside, c.centre)
        vague = person is not None and person.position_sd > self._config.max_position_sd
        expected = (person.x[:2].copy(), person.p[:2, :2].copy()) if person is not None and vague else None
        met = None if person is None else person.met
        for track, own in zip(tracks, densities, strict=True):
            away = track.x[:2] - robot
            noise = heading * float(away @ away) + 0.01**2
            track.update(t, c, noise, whole - own, in_view=view(track.x[:2]))
        if person is None or met is None or expected is None or person.seen != t:
            return False
        self._back = (t, person.x[:2] - robot, met)
        return rivalled(person.x[:2], *expected, c)

    def claimed(self, points: Array, hint: Array | None) -> Mask:
        """Which of points (n, 2) may be somebody's legs, so that they are not surroundings.

        Also those about where the person was said to start, ``hint``, until somebody is found there.
        """
        out = np.zeros(len(points), np.bool_)
        if self._hint is not None and hint is not None:
            out |= np.hypot(*(points - hint).T) < _HINT_REACH
        for track in self._all():
            if self.sure if track is self.person else walks(track):
                d = points - track.x[:2]
                out |= (d * d).sum(axis=1) < (0.4 + min(track.position_sd, 0.3)) ** 2
        return out

    def _all(self) -> list[LegTrack]:
        return self.others if self.person is None else [self.person, *self.others]

    def _retire(self, t: float, robot: Array, contradicted: bool) -> None:
        """Give up the person if there is what is seen contradicts it or nothing known any more, and others
        who are gone."""
        person = self.person
        if person is not None:
            known = known_before(person, robot)
            vague = person.position_sd > max(self._config.max_position_sd, _LOST_SD)
            if contradicted or vague or known is not None or t - person.seen > self._config.max_gap:
                if person.walked:
                    # Who came back and was not the person was met since: the place before counts.
                    self.lost = known or (self._back[2] if contradicted and self._back else person.met)
                    # Was beside the person, so is somebody else; what was followed since may be anything.
                    until = min(self.lost[0], person.sure[0])
                    for other in self.others:
                        other.stranger = other.born < until or _out_of_reach(other, self.lost)
                self._take(None, sure=False)
        self.others = [
            o
            for o in self.others
            if t - o.seen <= (_KEEP_TIME if walks(o) else _DROP_TIME)
            and (walks(o) or t - o.born < TRIAL)
            and o.position_sd < _STRANGER_SD
            and not o.ambiguous
            and not self._same(o)
        ]

    def _take(self, person: LegTrack | None, *, sure: bool) -> None:
        """Make somebody the person, or nobody."""
        self.person, self.sure = person, sure
        self._back, self._beside = None, np.zeros((0, 2))

    def _parts(self, t: float, robot: Array, motion: Array) -> bool:
        """Whether who came back just now goes against the robot's way, as a passer-by does."""
        if self.person is None or self._back is None or not _SEEN_BACK < t - self._back[0] < TRIAL:
            return False
        since, place, _ = self._back
        apart = float(np.hypot(*(self.person.x[:2] - robot - place)))
        return apart > COMPANY_SPEED * (t - since) and float(self.person.x[2:4] @ motion) < 0.0

    def _same(self, other: LegTrack) -> bool:
        """Whether a track has fallen together with the person's, or an older one."""
        for track in self._all():
            if track is other:
                return False
            if float(np.hypot(*(track.x[:2] - other.x[:2]))) < 0.2:
                return True
        return False

    def _begin(self, t: float, c: Candidates, robot: Array, hint: Array | None, view: View) -> None:
        """Take the likeliest reading of where the person was said to start; what else is there stands."""
        if self._hint is None or hint is None or self.person is not None or not len(c) or not view(hint):
            return
        told = LegTrack(t, hint, _HINT_SD**2 * np.eye(2), self._config.person).readings(c)
        if told is None:
            return
        best = int(np.argmax(told.weight))
        if told.swing[best] > _HALF**2 and t - self._began < _HINT_WAIT:  # one leg may hide the other
            return
        at = told.z[best]
        covariance = told.spread[best] + told.swing[best] * np.eye(2)
        found = LegTrack(t, at, covariance, self._config.person)
        found.robot = robot.copy()
        own = np.hypot(*(told.z - at).T) < np.where(told.swing > _HALF**2, OWN_LEGS, _SAME)
        self._take(found, sure=bool(told.weight[own].sum() > _SURE * (UNSEEN + told.weight.sum())))
        self._hint = None
        self._beside = c.centre[np.hypot(*(c.centre - at).T) > OWN_LEGS]

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
            found.stranger = _out_of_reach(found, place)
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
        able = [o for o in self.others if may_walk(o) and not o.stranger and accompanies(o, t, robot, motion)]
        if able:
            best = min(able, key=lambda o: float(np.hypot(*(o.x[:2] - place))))
            if confirmed(best, t, CONFIRM_TIME if known is None or len(able) > 1 else CONFIRM_SOON):
                self.others.remove(best)
                best.walked = True
                self._take(best, sure=True)


def _out_of_reach(track: LegTrack, known: tuple[float, Array]) -> bool:
    """Whether somebody began where the person cannot have come by then from where they were known to be."""
    since, place = known
    return float(np.hypot(*(track.start - place))) > _REACH_AT_ONCE + _WALK * (track.born - since)

"""T_CF of a camera that tracks itself: printed targets in the world of a phone (METHOD section 21).

A phone's tracking (WebXR) tells where its camera is, in metres, in a world that begins anywhere and drifts.
Where the phone saw a target once, it knows ever after where the target is, without looking at it; and where
Cs sees the same target, both together are T_CF at that instant of Cs, whatever the phone looks at.  Nothing
of it rests on the filter's own pose.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from collabslam.geometry import adjoint, pose_inverse
from collabslam.live.views import OwnPose
from collabslam.targets.kinds import Board, Tag
from collabslam.targets.printed import Sighting
from collabslam.types import Array

WAY_SD = 0.02
"""Standard deviation of each coordinate by drift, as a share of the way; it is assumed, not measured."""
TURN_SD = np.deg2rad(0.5)
"""The same about each axis: radians after a minute, growing with the root of time."""
KEPT = 8
"""Sightings that are kept of each target."""
FASTEST = 5.0
"""Metres per second: nobody walks so fast; the phone found itself elsewhere, and its world begins anew."""


@dataclass(frozen=True, eq=False)
class _PastSighting:
    """A sighting, and where the phone was then, after which way, at which time."""

    sighting: Sighting
    own: OwnPose
    way: float
    t: float


class OwnWorld:
    """One session of a phone: the way it went, and which targets it saw from where."""

    def __init__(self) -> None:
        self._seen: dict[Tag | Board | None, deque[_PastSighting]] = {}
        self._own: OwnPose | None = None
        self._way, self._t = 0.0, 0.0

    def move(self, t: float, own: OwnPose, seen: Iterable[Sighting]) -> None:
        """The phone is at ``own`` at ``t`` seconds and sees these targets."""
        if self._own is not None:
            step = float(np.linalg.norm(own.t_xf[:3, 3] - self._own.t_xf[:3, 3]))
            if step > FASTEST * max(abs(t - self._t), 0.05):
                self._seen.clear()
            self._way += step
        self._own, self._t = own, t
        for sighting in seen:
            kept = self._seen.setdefault(sighting.target, deque(maxlen=KEPT))
            kept.append(_PastSighting(sighting, own, self._way, t))

    def sightings(self) -> list[tuple[Sighting, Array | None]]:
        """Where the phone is now to each target that it ever saw, and what of the covariance (6, 6) lasts.

        Of several sightings of a target, the one from which it is known best.
        """
        return [min(map(self._now, kept), key=_volume) for kept in self._seen.values()]

    def _now(self, seen: _PastSighting) -> tuple[Sighting, Array | None]:
        assert self._own is not None
        if seen.own is self._own:
            return seen.sighting, None
        moved = pose_inverse(seen.own.t_xf) @ self._own.t_xf
        back = adjoint(pose_inverse(moved))
        apart = seen.sighting.covariance + seen.own.covariance
        way, minutes = self._way - seen.way, abs(self._t - seen.t) / 60.0
        drift = np.diag([(WAY_SD * way) ** 2] * 3 + [TURN_SD**2 * minutes] * 3)
        time_correlated = back @ apart @ back.T + drift
        time_correlated = 0.5 * (time_correlated + time_correlated.T)
        t_tc = seen.sighting.t_tc @ moved
        return replace(
            seen.sighting, t_tc=t_tc, covariance=time_correlated + self._own.covariance
        ), time_correlated


def _volume(found: tuple[Sighting, Array | None]) -> float:
    return float(np.linalg.slogdet(found[0].covariance)[1])


class OwnWorlds:
    """The world of the session at work; another one begins anew."""

    def __init__(self) -> None:
        self._session, self._world = "", OwnWorld()

    def of(self, session: str) -> OwnWorld:
        """The world of a session."""
        if session != self._session:
            self._session, self._world = session, OwnWorld()
        return self._world


def shared(
    of_cs: Sequence[Sighting], of_cf: Sequence[tuple[Sighting, Array | None]]
) -> list[tuple[Sighting, Sighting, Array | None]]:
    """Sightings of the same target from both cameras, and what lasts of the second one's covariance."""
    by_target = {s.target: s for s in of_cs}
    return [
        (by_target[s.target], s, time_correlated) for s, time_correlated in of_cf if s.target in by_target
    ]

"""Whether Cf confirms the map's size, view by view, and how far the camera has gone since (METHOD 22)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from collabslam._core import Filter
from collabslam.formats.schema import Check, array, covariance, flag, number, optional, table
from collabslam.frontend.worn_size import (
    CHANGES,
    LAST_VIEWS,
    LEAST_TOLD,
    WINDOWS,
    changed_length,
    contradicted_size,
)
from collabslam.slam.state import PersistentState
from collabslam.slam.usual_speed import UsualSpeed
from collabslam.slam.worn.overlaps import Overlaps
from collabslam.types import Array

_CONFIRMING = 20
"""Frames in which a camera in a new map goes as it did before the old one lost its size."""


class MapSize(PersistentState):
    """What the views of all worn cameras have said of the map that the camera is in.

    Parameters
    ----------
    core : Filter
    usual_speed : UsualSpeed
    bias_time : float
        How long what lasts of T_CF's error does, seconds.

    Attributes
    ----------
    doubt : float
        By how much the logarithm of T_CF's lengths, or of the map's, was found to have changed at most.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_told": array("<f8", None),
        "_confirmed": optional(array("<f8", 3)),
        "_last": array("<f8", 3),
        "_places": covariance(4),
        "_anew": flag,
        "_speeds": optional(array("<f8", None)),
        "_lengths": table(int, array("<f8", None, 6)),
        "doubt": number(0.0, 1.0),
    }

    def __init__(self, core: Filter, usual_speed: UsualSpeed, bias_time: float) -> None:
        self._filter, self._usual, self._bias_time = core, usual_speed, bias_time
        self._told = np.empty(0)
        # Where a view last confirmed it, where the camera was last, and moments of the places in between,
        # each with 1 as a fourth number, seen from the first and weighted by the way through them.
        self._confirmed: Array | None = None
        self._last, self._places = np.zeros(3), np.zeros((4, 4))
        self._anew = False
        # Of the frames in a map that was begun because one was contradicted in which the camera went as fast
        # as it never does; None if that one's speed was usual, so that T_CF may as well be what is wrong.
        self._speeds: Array | None = None
        self._lengths: dict[int, Array] = {}
        self.doubt = 0.0

    def take(self, overlap: Overlaps, t_wc: Array) -> None:
        """Takes in what the views of a frame said, and the pose of Cs (4, 4) in it."""
        told = [seen.size for seen in overlap.each if not np.isnan(seen.size)]
        self._told = np.concatenate([self._told, told])[-LAST_VIEWS:]
        place = t_wc[:3, 3]
        if told and max(told) <= 1.0:
            self._confirmed, self._places = place.copy(), np.zeros((4, 4))
        elif self._confirmed is not None:
            between = np.append(0.5 * (self._last + place) - self._confirmed, 1.0)
            self._places = self._places + np.linalg.norm(place - self._last) * np.outer(between, between)
        self._last = place.copy()
        if self._anew and self._speeds is not None:
            self._speeds = np.append(self._speeds, self._speed())[-_CONFIRMING:]
            if len(self._speeds) == _CONFIRMING and self._usual.is_usual(float(np.median(self._speeds))):
                self._anew = False

    def take_length(self, who: int, length: Array) -> None:
        """Takes in what a worn camera's view was found to say of |t_CF|, (6,) as `changed_length` says.

        Which of both has changed nothing tells, so that the camera's lengths and what is in view are in doubt
        by as much from now on.  A view that tells hardly anything of it does not count: a single one that
        does would stand for all.
        """
        if length[1] < LEAST_TOLD:
            return
        known = self._lengths.get(who, np.empty((0, 6)))
        rows = np.vstack([known, length])[-(max(WINDOWS) + max(CHANGES)) :]
        self._lengths = self._lengths | {who: rows}
        changed = min(changed_length(rows, self._bias_time), 1.0)
        if changed > 0.0:
            self._filter.doubt_length(who, changed)
            self.doubt = max(self.doubt, changed)

    @property
    def contradicted(self) -> bool:
        """Whether views contradict it."""
        return contradicted_size(self._told)

    @property
    def inconsistent(self) -> bool:
        """Whether they do, or the map was begun because they did: by T_CF, which may as well be wrong.

        Not once the camera is known to go in it as it mostly does, and not to have done so in the one before.
        """
        return self.contradicted or self._anew

    def gone(self, t_wc: Array) -> Array:
        """Square (3, 3) of the way in W to a pose of Cs (4, 4) that may be of the wrong size, m^2.

        Where on its way since the size was last confirmed the map lost it nobody knows, and a way that bends
        is as wrong as it is long along both of its legs: the mean over all places on it of the square of the
        way from there, times three, which is the square of all of it if it is straight.
        """
        along = self._places[3, 3]
        if self._confirmed is None or along <= 0.0:
            return np.zeros((3, 3))
        from_there = np.hstack([-np.eye(3), (t_wc[:3, 3] - self._confirmed)[:, None]])
        square = 3.0 / along * from_there @ self._places @ from_there.T
        return np.asarray(0.5 * (square + square.T))

    def leave(self, *, contradicted: bool, speed: float) -> None:
        """The camera, which went at a ``speed`` (m/s), is in another map: one begun because the last one was
        contradicted, or any."""
        self._told, self._confirmed, self._anew = np.empty(0), None, contradicted
        self._places = np.zeros((4, 4))
        self._lengths = {}
        self._speeds = np.empty(0) if self._usual.is_usual(speed) is False else None

    def _speed(self) -> float:
        return float(np.linalg.norm(self._filter.velocity))

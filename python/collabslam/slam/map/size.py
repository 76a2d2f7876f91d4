"""Whether Cf confirms the map's size, view by view, and how far the camera has gone since (METHOD 22)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from collabslam.formats.schema import Check, array, flag, optional, pose, table
from collabslam.frontend.worn_size import (
    LAST_VIEWS,
    LEAST_TOLD,
    WINDOWS,
    contradicted_length,
    contradicted_size,
)
from collabslam.slam.state import PersistentState
from collabslam.slam.worn.overlaps import Overlaps
from collabslam.types import Array


class MapSize(PersistentState):
    """What the views of all worn cameras have said of the map that the camera is in."""

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_told": array("<f8", None),
        "_confirmed": optional(pose),
        "_anew": flag,
        "_lengths": table(int, array("<f8", None, 3)),
    }

    def __init__(self) -> None:
        self._told = np.empty(0)
        self._confirmed: Array | None = None
        self._anew = False
        self._lengths: dict[int, Array] = {}

    def take(self, overlap: Overlaps, t_wc: Array) -> None:
        """Takes in what the views of a frame said, and the pose of Cs (4, 4) in it."""
        told = [seen.size for seen in overlap.each if not np.isnan(seen.size)]
        self._told = np.concatenate([self._told, told])[-LAST_VIEWS:]
        if told and max(told) <= 1.0:
            self._confirmed = t_wc

    def take_length(self, number: int, error: float, told: float, lasting: float) -> None:
        """Takes in what a worn camera's view was found to say of |t_CF| (`contradicted_length`).

        A view that tells hardly anything of it does not count: a single one that does would stand for all.
        """
        if told < LEAST_TOLD:
            return
        rows = np.vstack([self._lengths.get(number, np.empty((0, 3))), [error, told, lasting]])[
            -max(WINDOWS) :
        ]
        self._lengths = self._lengths | {number: rows}

    @property
    def contradicted(self) -> bool:
        """Whether views contradict it."""
        return contradicted_size(self._told)

    @property
    def inconsistent(self) -> bool:
        """Whether they do, or the map was begun because they did: by T_CF, which may as well be wrong.

        So it is while T_CF's lengths have changed: the map follows them, and its parts differ in size.
        """
        changed = any(contradicted_length(rows) for rows in self._lengths.values())
        return self.contradicted or self._anew or changed

    def gone(self, t_wc: Array) -> Array:
        """Way (3,) in W since it was last confirmed, metres, from a pose of Cs (4, 4)."""
        return np.zeros(3) if self._confirmed is None else t_wc[:3, 3] - self._confirmed[:3, 3]

    def leave(self, *, contradicted: bool) -> None:
        """The camera is in another map: one begun because this one's size was contradicted, or any."""
        self._told, self._confirmed, self._anew = np.empty(0), None, contradicted
        self._lengths = {}

"""Whether what a run sees fits what it takes for granted: calibrations, T_CF, a scene that stands still.

Such a fault does not show in any one frame: the map takes most of it up.  What is left adds up over frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from collabslam._core import UpdateReport, chi2_quantile
from collabslam.formats.schema import Check, array, whole
from collabslam.settings.setting import Value
from collabslam.slam.state import PersistentState
from collabslam.slam.worn_frame import Overlap
from collabslam.types import Array

NOTHING = ""
WORN, WORN_MATCHES, MATCHES, NOISE = "t_cf", "cf_matches", "matches", "noise"
CAUSES = (WORN, WORN_MATCHES, MATCHES, NOISE)
"""What a run can be doubted for, the most telling first."""

_LAST = 30
"""Frames, and views of Cf, that the tests look back on."""
_LEAST = 5
"""Frames, or views, that say something together."""
_LEVEL = 0.9999
"""Level of each test."""


class Doubts(PersistentState):
    """Tests over the last frames: what was seen against what the settings and T_CF's covariance claim.

    Parameters
    ----------
    settings : mapping
        The filter's.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_matches": array("<f8", None, 2),
        "_noise": array("<f8", None, 2),
        "_worn_matches": array("<f8", None, 2),
        "_corrections": array("<f8", None, 6),
        "_claimed": array("<f8", None, 6, 6),
        "_refused": array("<f8", None),
        "_without_view": whole(0),
    }

    def __init__(self, settings: Mapping[str, Value]) -> None:
        # A good batch fails the test of the batch with this probability, and loses a match or two then.
        self._expected = 1.0 - float(settings["validate.level"])
        self._matches = np.empty((0, 2))
        self._noise = np.empty((0, 2))
        self._worn_matches = np.empty((0, 2))
        self._corrections = np.empty((0, 6))
        self._claimed = np.empty((0, 6, 6))
        self._refused = np.empty(0)
        self._without_view = 0

    def judge(self, report: UpdateReport, found: int, overlap: Overlap) -> str:
        """Takes a frame in, if it was used; returns one of `CAUSES`, or `NOTHING`."""
        if report.accepted:
            self._take(report, found, overlap)
        doubted = {
            WORN: self._worn_is_elsewhere(),
            WORN_MATCHES: self._too_many(self._worn_matches),
            MATCHES: self._too_many(self._matches),
            NOISE: self._too_loud(),
        }
        return next((cause for cause in CAUSES if doubted[cause]), NOTHING)

    def _take(self, report: UpdateReport, found: int, overlap: Overlap) -> None:
        bearings, pairs = report.bearings, report.pairs
        refused = bearings.rejected_gate + bearings.rejected_batch + bearings.rejected_conditional
        self._matches = _last(self._matches, [refused, found], _LAST)
        self._noise = _last(self._noise, [report.nis, report.dof], _LAST)
        self._without_view = 0 if overlap.points else self._without_view + 1
        if self._without_view > _LAST:  # Cf may have moved on since
            self._forget_views()
        if overlap.points:
            wrong = pairs.rejected_gate + pairs.rejected_batch + pairs.rejected_conditional
            self._worn_matches = _last(self._worn_matches, [wrong, len(overlap.ids)], _LAST)
            self._refused = _last(self._refused, float(overlap.refused), _LAST)
        if overlap.worn is not None and np.isfinite(overlap.correction).all():
            self._corrections = _last(self._corrections, overlap.correction, _LAST)
            self._claimed = _last(self._claimed, overlap.worn.covariance, _LAST)

    def _forget_views(self) -> None:
        """What views of Cf said does not count for ever once there are none."""
        self._worn_matches, self._refused = self._worn_matches[:0], self._refused[:0]
        self._corrections, self._claimed = self._corrections[:0], self._claimed[:0]

    def _too_many(self, counts: Array) -> bool:
        """Whether more matches were refused than the level of their tests explains, counts being Poisson."""
        refused, found = counts.sum(axis=0)
        if len(counts) < _LEAST or refused < 1.0:
            return False
        return bool(0.5 * chi2_quantile(1.0 - _LEVEL, 2.0 * refused) > self._expected * found)

    def _too_loud(self) -> bool:
        """Whether innovations are larger than their covariance allows."""
        nis, dof = self._noise.sum(axis=0)
        return bool(len(self._noise) >= _LEAST and dof >= 1.0 and nis > chi2_quantile(_LEVEL, dof))

    def _worn_is_elsewhere(self) -> bool:
        """Whether the matches correct T_CF again and again in one direction, by more than one error explains
        that all views share; or whether most views contradict it so much that they are not used.
        """
        if len(self._refused) >= _LEAST and self._refused.mean() > 0.5:
            return True
        if len(self._corrections) < _LEAST:
            return False
        mean, claimed = self._corrections.mean(axis=0), self._claimed.mean(axis=0)
        return float(mean @ np.linalg.solve(claimed, mean)) > chi2_quantile(_LEVEL, 6)


def _last(kept: Array, new: object, count: int) -> Array:
    """The last rows, with a new one."""
    return np.concatenate([kept, np.asarray(new, np.float64)[None]])[-count:]

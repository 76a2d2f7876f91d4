"""Whether what a run sees fits what it takes for granted: calibrations, T_CF, a scene that stands still.

Such a fault does not show in any one frame: the map takes most of it up.  What is left adds up over frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from collabslam._core import SURE_LEVEL, FilterSettings, MeasurementOutcomes, UpdateReport, chi2_quantile
from collabslam.formats.schema import Check, array, fields, table, whole
from collabslam.frontend.worn_verdict import contradicted, contradicted_lately, moved_too_far
from collabslam.slam.gyro_monitor import GyroMonitor
from collabslam.slam.map.size import MapSize
from collabslam.slam.map_change import MapChange
from collabslam.slam.state import PersistentState
from collabslam.slam.worn.overlap import Overlap
from collabslam.slam.worn.overlaps import Overlaps
from collabslam.types import Array

NOTHING = ""
GYRO = "gyro"
WORN, WORN_MATCHES, SIZE, JUMP = "t_cf", "cf_matches", "size", "jump"
MATCHES, MOVING, NOISE, ATTITUDE = "matches", "moving", "noise", "attitude"
CAUSES = (GYRO, WORN, WORN_MATCHES, SIZE, JUMP, MATCHES, MOVING, NOISE, ATTITUDE)
"""Causes for which a frame is DEGRADED, the most telling first."""

_LAST = 30
"""Frames, and views of Cf, that the tests look back on."""
_LAST_BIRTHS = 100
"""Frames that the test of new points looks back on: few are new in a frame, and what slides slowly leaves few
of them in thirty."""
_LEAST = 5
"""Frames, or views, that say something together."""
_NO_VIEWS: dict[str, Any] = {
    "against": np.empty(0),
    "moved": np.empty((0, 2)),
    "matches": np.empty((0, 2)),
    "without": 0,
}
_STRAYS = 0.01
"""Share of new points that may stray in a scene that stands still, by a wrong match."""
_PASSING = 0.05
"""Share of them that may be on what moves: so few landmarks are outvoted by the others."""


class ConsistencyMonitor(PersistentState):
    """Tests over the last frames: what was seen against what the settings and T_CF's covariance claim.

    Parameters
    ----------
    settings : FilterSettings
    size : MapSize
        What views of Cf say of the map's size.
    gyro : GyroMonitor, optional
        What the images say of a gyroscope.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_matches": array("<f8", None, 2),
        "_noise": array("<f8", None, 2),
        "_births": array("<f8", None, 2),
        "_jumps": array("<f8", None),
        "_worn": table(
            int,
            fields(
                against=array("<f8", None),
                moved=array("<f8", None, 2),
                matches=array("<f8", None, 2),
                without=whole(0),
            ),
        ),
    }

    def __init__(self, settings: FilterSettings, size: MapSize, gyro: GyroMonitor | None = None) -> None:
        self._size, self._gyro = size, gyro
        # A good batch fails the test of the batch with this probability, and loses a match or two then.
        self._expected = 1.0 - settings.validate.level
        self._bias_share = settings.worn.bias_share
        self._matches = np.empty((0, 2))
        self._noise = np.empty((0, 2))
        self._births = np.empty((0, 2))
        self._jumps = np.empty(0)
        # By the number of the worn camera: how much its views contradict T_CF, how far the map moves it,
        # matches refused and found, and frames since its last view.
        self._worn: dict[int, dict[str, Any]] = {}

    def judge(
        self, report: UpdateReport, found: int, overlap: Overlaps, change: MapChange, *, jumped: bool = False
    ) -> str:
        """Takes a frame in; what it saw of the map counts if it was used.

        ``jumped`` says whether the camera was found again where prediction excludes it.  Returns one of
        `CAUSES` but the last, or `NOTHING`.
        """
        self._jumps = _last(self._jumps, float(jumped), _LAST)
        for seen in overlap.each:
            if not np.isnan(seen.against):
                known = self._worn.get(seen.number, _NO_VIEWS)
                against = _last(known["against"], seen.against, _LAST)
                self._worn = self._worn | {seen.number: known | {"against": against}}
        if report.accepted:
            self._take(report, found, change)
            self._take_worn(overlap.with_outcomes(report), report)
        return self.standing()

    def standing(self) -> str:
        """What the frames so far contradict: a camera that is lost does not make its map any better."""
        inconsistent = {
            GYRO: self._gyro is not None and self._gyro.at_odds,
            WORN: any(
                one["without"] <= _LAST
                and (
                    contradicted(one["against"])
                    or contradicted_lately(one["against"])
                    or moved_too_far(*one["moved"].T)
                )
                for one in self._worn.values()
            ),
            WORN_MATCHES: any(self._too_many_refused(one["matches"]) for one in self._worn.values()),
            SIZE: self._size.inconsistent,
            JUMP: bool(self._jumps.any()),
            MATCHES: self._too_many_refused(self._matches),
            MOVING: _too_many(self._births, _STRAYS, least=_PASSING),
            NOISE: self._too_loud(),
        }
        return next((cause for cause in CAUSES if inconsistent.get(cause)), NOTHING)

    def _take(self, report: UpdateReport, found: int, change: MapChange) -> None:
        bearings = report.bearings
        refused = bearings.rejected_gate + bearings.rejected_batch + bearings.rejected_conditional
        self._matches = _last(self._matches, [refused, found], _LAST)
        self._noise = _last(self._noise, [report.nis, report.dof], _LAST)
        # What strays by x times what is allowed passes in one direction of x; a landmark has passed twice.
        passed = float((change.off_arc**-2.0).sum())
        ended = len(change.delayed) + len(change.off_arc)
        self._births = _last(self._births, [passed, ended], _LAST_BIRTHS)

    def _take_worn(
        self, overlaps: list[tuple[Overlap, MeasurementOutcomes | None]], report: UpdateReport
    ) -> None:
        first = next((seen for seen, pairs in overlaps if pairs is not None), None)  # the error is its
        looked = {seen.number: (seen, outcomes) for seen, outcomes in overlaps if seen.points}
        worn = {}
        for number in sorted({*self._worn, *looked}):
            known = self._worn.get(number, _NO_VIEWS)
            without = 0 if number in looked else known["without"] + 1
            # Cf may have moved on since: what it said does not count for ever
            gone = without > _LAST
            matches, moved = (known[name][:0] if gone else known[name] for name in ("matches", "moved"))
            if number in looked:
                seen, pairs = looked[number]
                wrong = 0
                if pairs is not None:
                    wrong = pairs.rejected_gate + pairs.rejected_batch + pairs.rejected_conditional
                matches = _last(matches, [wrong, len(seen.ids)], _LAST)
                # Of a view of another time the motion in between is in the error, too.
                if seen is first and seen.given is seen.worn:
                    error, of_map = report.worn_error, report.worn_error_of_map
                    moved = _last(moved, seen.moved(error, of_map, self._bias_share), _LAST)
                    left = report.worn_error_covariance
                    self._size.take_length(number, seen.length(error, left, of_map, self._bias_share))
            worn[number] = known | {"matches": matches, "moved": moved, "without": without}
        self._worn = worn

    def _too_many_refused(self, counts: Array) -> bool:
        """Whether the test of the batch has refused more than its level explains.

        It refuses what does not fit together, so that the refusals of a batch have one cause, and one view
        that has an error of its own is no more than one view, however many matches it has.
        """
        refused = counts[:, 0]
        each = float(refused @ refused) / max(float(refused.sum()), 1.0)
        return _too_many(counts / max(each, 1.0), self._expected)

    def _too_loud(self) -> bool:
        """Whether innovations are larger than their covariance allows."""
        nis, dof = self._noise.sum(axis=0)
        return bool(len(self._noise) >= _LEAST and dof >= 1.0 and nis > chi2_quantile(SURE_LEVEL, dof))


def _too_many(counts: Array, expected: float, least: float = 0.0) -> bool:
    """Whether more events than ``expected``, a share, of what there was show in (N, 2) counts of both.

    They must be more than ``least`` of it, too, sure or not.
    """
    events, all_ = counts.sum(axis=0)
    if len(counts) < _LEAST or events < 1.0 or events <= least * all_:
        return False
    return bool(0.5 * chi2_quantile(1.0 - SURE_LEVEL, 2.0 * events) > expected * all_)


def _last(kept: Array, new: object, count: int) -> Array:
    """The last rows, with a new one."""
    return np.concatenate([kept, np.asarray(new, np.float64)[None]])[-count:]

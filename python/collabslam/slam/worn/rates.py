"""Whether the gyroscopes of worn cameras turn as these cameras do (METHOD 6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from collabslam._core import SURE_LEVEL, Filter, UpdateReport, chi2_quantile
from collabslam.formats.schema import Check, array, table
from collabslam.geometry import rotation_log
from collabslam.settings.table import Settings
from collabslam.slam.gyro_monitor import TOO_MANY
from collabslam.slam.state import PersistentState
from collabslam.slam.view import View
from collabslam.slam.worn.overlap import Overlap
from collabslam.slam.worn.overlaps import Overlaps
from collabslam.types import Array, Mask

_LAST = 15
"""Rates of a worn camera of which `TOO_MANY` may not be contradicted."""
_NEAR = 0.25
"""Seconds between two views beyond which their rates say nothing of the turn between them."""
_CHI2 = chi2_quantile(SURE_LEVEL, 3)
"""Of the three numbers of a turn."""
_POSE_SD = 0.05
"""rad/s by which Cs's own attitudes at both views may make that turn seem faster."""
_BENT = 0.1
"""Share of a rate by which the mean of two may miss that of all between them."""
_SAID = ("rate", "rejected-gate", "rejected-batch", "rejected-conditional")
"""What of a rate says whether it turns as the matches do."""


class WornRates(PersistentState):
    """Holds the gyroscope of a worn camera against its attitudes; leaves out one that is contradicted often.

    The filter refuses a rate that a view's matches contradict, where these tell how the camera turned.  Where
    they do not, T_CF of two views does: a rate that goes otherwise than the camera did from one to the other
    is not given to the filter.

    Parameters
    ----------
    core : Filter
    settings : Settings
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_refused": table(str, array("|b1", None)),
        "_before": table(str, array("<f8", 13)),
    }

    def __init__(self, core: Filter, settings: Settings) -> None:
        self._filter = core
        self._rate_sd = float(settings.filter.worn.rate_sd)
        self._bias_share = float(settings.filter.worn.bias_share)
        self._refused: Mapping[str, Mask] = {}
        self._before: Mapping[str, Array] = {}  # of the last view: time, attitude in W row by row, rate
        self._used = self._contradicted = 0

    def begin(self) -> None:
        """A frame begins."""
        self._used = self._contradicted = 0

    def believed(self, view: View) -> View:
        """The predicted frame, without rates that its views' attitudes contradict, or that are left out."""
        return view if view.lost else replace(view, worn=tuple(map(self._believed, view.worn)))

    def take(self, overlap: Overlaps, report: UpdateReport) -> None:
        """Takes in what became of the rates of a frame's views."""
        if all(one.given.rate is None for one in overlap.used):
            return
        for one, outcome in zip(overlap.used, report.rates.names, strict=True):
            if outcome in _SAID:
                self._note(one.worn.who, refused=outcome != "rate")

    def counts(self) -> dict[str, int]:
        """Of the frame's diagnostics: rates of worn cameras that were used, and contradicted; none where no
        view has told one."""
        if not self._refused:
            return {}
        return {"cf_rate_used": self._used, "cf_rate_contradicted": self._contradicted}

    def _believed(self, one: Overlap) -> Overlap:
        who, rate = one.worn.who, one.given.rate
        if rate is None:
            return one
        if self._refused.get(who, np.zeros(0, bool)).sum() >= TOO_MANY:
            return _without_rate(one)
        attitude = self._filter.pose[:3, :3] @ one.worn.t_cf[:3, :3]
        before = self._before.get(who)
        self._before = {**self._before, who: np.concatenate([[one.taken], attitude.ravel(), rate])}
        if before is None or not self._contradicts(one, before, attitude, rate):
            return one
        self._note(who, refused=True)
        return _without_rate(one)

    def _contradicts(self, one: Overlap, before: Array, attitude: Array, rate: Array) -> bool:
        """Whether a worn camera has turned since its last view otherwise than both rates say."""
        apart = one.taken - float(before[0])
        if not 0.0 < apart <= _NEAR:
            return False
        given, last = one.given, before[10:]
        lasts = given.covariance * self._bias_share if given.bias is None else given.bias
        spread = 2.0 * (given.covariance - lasts)[3:, 3:] / apart**2
        sds = (self._rate_sd, 0.5 * np.linalg.norm(rate - last), _POSE_SD)
        bent = _BENT * max(np.linalg.norm(rate), np.linalg.norm(last))
        spread = spread + np.eye(3) * float(np.sum(np.square([*sds, bent])))
        turned = rotation_log(before[1:10].reshape(3, 3).T @ attitude) / apart
        off = turned - 0.5 * (rate + last)
        return float(off @ np.linalg.solve(spread, off)) > _CHI2

    def _note(self, who: str, *, refused: bool) -> None:
        before = self._refused.get(who, np.zeros(0, bool))
        self._refused = {**self._refused, who: np.append(before, refused)[-_LAST:]}
        self._used += not refused
        self._contradicted += refused


def _without_rate(one: Overlap) -> Overlap:
    given = replace(one.given, rate=None)
    return replace(one, given=given, worn=given if one.worn is one.given else replace(one.worn, rate=None))

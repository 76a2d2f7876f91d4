"""Numbers about a frame that no other part of the engine asks for: times and counts."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from collabslam._core import UpdateReport
from collabslam.frontend.search import SearchCode
from collabslam.slam.map_change import Recovered
from collabslam.slam.tracking.tracks import Found


class StageTimes:
    """Milliseconds per stage of one frame, from where it is made."""

    def __init__(self) -> None:
        self._began = self._last = time.perf_counter()
        self._ms: dict[str, float] = {}

    def done(self, stage: str) -> None:
        """A stage is over; the next one begins."""
        now = time.perf_counter()
        self._ms[f"ms_{stage}"] = 1e3 * (now - self._last)
        self._last = now

    def all(self) -> dict[str, float]:
        """``ms_`` and the name of each stage, and ``ms_total``."""
        return {**self._ms, "ms_total": 1e3 * (self._last - self._began)}


def search_counts(predicted: int, found: Found, report: UpdateReport) -> dict[str, Any]:
    """What became of the features: predicted, searched, found, and rejected for which reason."""
    codes = found.result.code
    outcomes = report.bearings
    return {
        "predicted": predicted,
        "searched": len(found.searched),
        "found": len(found.ids),
        "rejected_low_score": int(np.sum(codes == SearchCode.LOW_SCORE)),
        "rejected_ambiguous": int(np.sum(codes == SearchCode.AMBIGUOUS)),
        "rejected_outside": int(np.sum(codes == SearchCode.OUTSIDE)),
        "rejected_chi2": outcomes.rejected_gate,
        "rejected_hohct": outcomes.rejected_batch,
        "rejected_conditional": outcomes.rejected_conditional,
        "nis": report.nis,
        "nis_dof": report.dof,
        "hohct_order": report.order,
        "hohct_exact": int(report.exact),
        "bounded": int(not report.exact),
        "refused": int(report.refused is not None),
        "unseen": 0,
    }


def recovery_counts(recovered: Recovered | None) -> dict[str, Any]:
    """Whether the camera was found again in its map, or a map was begun, and then from what."""
    if recovered is None:
        return {"relocalised": 0, "restarted": 0}
    found = recovered.begun is None
    return {**recovered.counts, "relocalised": int(found), "restarted": int(not found)}

"""What one frame has measured, and what that does to the map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from collabslam._core import Prediction, UpdateReport
from collabslam.frontend.search import AMBIGUOUS, FOUND, LOW_SCORE, SearchCode
from collabslam.results import FrameFeatures
from collabslam.slam.map_change import ImagePoints, MapChange, Recovered
from collabslam.slam.tracking.tracks import TrackingResult
from collabslam.slam.view import View
from collabslam.slam.worn.overlaps import Overlaps

_STATES = {FOUND: "rejected", LOW_SCORE: "unlike", AMBIGUOUS: "ambiguous"}
"""What a search's answer says of a feature that the filter did not accept; "outside" in all other cases."""


@dataclass(frozen=True)
class FrameOutcome:
    """Attributes
    ----------
    view : View
    expected : Prediction
        Features that were to be searched.
    found : TrackingResult
    overlap : Overlaps
    report : UpdateReport
    recovered : Recovered or None
        How the camera was found where the update failed.
    change : MapChange
    followed : bool
        Whether odometry predicted the frame.
    slipped : bool
        Whether the wheels have slipped.
    turned : bool
        Whether images (METHOD 27) or a gyroscope (METHOD 28) told its turn, and the map told nothing.
    """

    view: View
    expected: Prediction
    found: TrackingResult
    overlap: Overlaps
    report: UpdateReport
    recovered: Recovered | None
    change: MapChange
    followed: bool
    slipped: bool
    turned: bool

    @property
    def accepted(self) -> bool:
        """Whether something tells where the camera is."""
        return self.report.accepted or self.recovered is not None or self.turned

    @property
    def found_again(self) -> bool:
        """Whether the camera was found in a map that there was."""
        return self.recovered is not None and self.recovered.begun is None

    @property
    def jumped(self) -> bool:
        """Whether a camera that was not lost is where it cannot be; wheels that predicted may be wrong."""
        jumped = self.recovered is not None and self.recovered.jumped
        return jumped and not (self.view.lost or self.followed)

    @cached_property
    def seen(self) -> ImagePoints:
        """Features that the pose rests on."""
        if self.recovered is not None:
            return self.recovered.seen
        accepted = self.report.bearings.accepted
        return ImagePoints(self.found.ids[accepted], self.found.uv[accepted])

    @property
    def inliers(self) -> int:
        """Measurements that the pose rests on; a start without depth has none but its features."""
        undelayed = 0 if self.view.started else len(self.change.undelayed)
        return len(self.seen) + self.change.with_depth + undelayed

    @property
    def features(self) -> FrameFeatures:
        """What became of each feature that should be visible."""
        ids, found = self.expected.ids, self.found
        codes = zip(found.searched.tolist(), found.result.code.tolist(), strict=True)
        states = {i: _STATES.get(code, "outside") for i, code in codes}
        states.update(dict.fromkeys(found.ids[self.report.bearings.accepted].tolist(), "accepted"))
        row = {i: k for k, i in enumerate(ids.tolist())}
        place = np.full((len(ids), 2), np.nan)
        place[[row[i] for i in found.ids.tolist()]] = found.uv
        return FrameFeatures(
            ids,
            self.expected.uv,
            self.expected.s,
            place,
            [states.get(i, "not searched") for i in ids.tolist()],
            self.overlap.pixels,
            self.overlap.names,
            self.view.left_out,
        )

    def counts(self) -> dict[str, Any]:
        """Of the diagnostics."""
        return {
            **self._search_counts(),
            **self.overlap.counts(self.report),
            **self._recovery_counts(),
            **self.change.counts(),
            "accepted": self.inliers,
            "slipped": int(self.slipped),
            "turned": int(self.turned),
            "left_out_pct": 0.0 if self.view.left_out is None else 100.0 * float(self.view.left_out.mean()),
        }

    def _search_counts(self) -> dict[str, Any]:
        """What became of the features: predicted, searched, found, and rejected for which reason."""
        codes, outcomes, report = self.found.result.code, self.report.bearings, self.report
        return {
            "predicted": len(self.expected),
            "searched": len(self.found.searched),
            "found": len(self.found.ids),
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

    def _recovery_counts(self) -> dict[str, Any]:
        """Whether the camera was found again in its map, or a map was begun, and then from what."""
        if self.recovered is None:
            return {"relocalised": 0, "restarted": 0}
        again = self.found_again
        return {**self.recovered.counts, "relocalised": int(again), "restarted": int(not again)}

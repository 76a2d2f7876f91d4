"""What Cs and all worn cameras see together in one frame (METHOD 6): one `Overlap` each, measured in turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from collabslam._core import Filter, MeasurementOutcomes, UpdateReport, WornMeasurement
from collabslam.frontend.patch import Patch
from collabslam.results import WornPose
from collabslam.slam.map_change import ImagePoints
from collabslam.slam.view import View
from collabslam.slam.worn.overlap import Overlap
from collabslam.types import Array, Ids, WornView


@dataclass(frozen=True)
class Overlaps:
    """The overlaps of a frame, of the worn cameras in their order.

    Attributes
    ----------
    each : tuple of Overlap
    """

    each: tuple[Overlap, ...] = ()

    @property
    def used(self) -> list[Overlap]:
        """Those that are measured: the first together with what Cs found, each other one by itself."""
        return [overlap for overlap in self.each if overlap.measured]

    @property
    def ids(self) -> Ids:
        """(M,) int64: features that the first one measures, -1 for new points."""
        used = self.used
        return used[0].ids if used else np.empty(0, np.int64)

    @property
    def views(self) -> list[WornMeasurement]:
        """The argument ``views`` of :meth:`Filter.update`."""
        return [overlap.observation for overlap in self.used]

    @property
    def pixels(self) -> Array:
        """(M, 4) float64: pixels in Cs and in Cf of what both see."""
        return np.concatenate([np.empty((0, 4)), *(o.pixels for o in self.each)])

    @property
    def names(self) -> list[str]:
        """Whose worn camera each of those is of."""
        return [o.worn.who for o in self.each if o.measured for _ in o.pixels]

    def with_outcomes(self, report: UpdateReport) -> list[tuple[Overlap, MeasurementOutcomes | None]]:
        """Each with what the filter did with its matches; None where it was not measured."""
        outcomes = iter(report.views)
        return [(overlap, next(outcomes) if overlap.measured else None) for overlap in self.each]

    def births(self, report: UpdateReport, t: float) -> tuple[ImagePoints, Ids]:
        """Features born from pairs of the frame at ``t``, and the candidates (C,) that births use up."""
        born, used = ImagePoints(), [np.empty(0, np.int64)]
        for overlap, outcomes in self.with_outcomes(report):
            if outcomes is not None:
                more, candidates = overlap.births(outcomes, t)
                born = born.with_more(more)
                used.append(candidates)
        return born, np.concatenate(used)

    def earlier_births(self, report: UpdateReport, core: Filter, t: float) -> dict[int, Patch]:
        """Features born from pairs of frames before the one at ``t``, with their patches from there."""
        patches: dict[int, Patch] = {}
        for overlap, outcomes in self.with_outcomes(report):
            if outcomes is not None:
                patches |= overlap.earlier_births(outcomes, core, t)
        return patches

    def counts(self, report: UpdateReport) -> dict[str, Any]:
        """Diagnostics of the worn cameras: counts of all together, and numbers of the one that speaks most
        against its T_CF."""
        told = [overlap.counts(outcomes) for overlap, outcomes in self.with_outcomes(report)]
        if not told:
            return _NOBODY.counts(None)
        worst = max(told, key=lambda counts: np.nan_to_num(counts["t_cf_against"], nan=-1.0))
        numbers = {name for name, value in worst.items() if isinstance(value, float)}
        return {name: worst[name] if name in numbers else sum(c[name] for c in told) for name in worst}

    def poses(self, core: Filter, report: UpdateReport, view: View) -> dict[str, WornPose]:
        """Where the worn cameras were when the views of this frame were taken, by name."""
        if view.lost or not core.started:
            return {}
        matches = {overlap.number: len(overlap.ids) for overlap in self.each}
        out = {}
        for seen in view.worn:
            measured = seen.number in report.worn_poses
            found = report.worn_poses[seen.number] if measured else core.worn_pose(seen.observation)
            out[seen.worn.who] = WornPose(
                *found,
                measured,
                seen.taken,
                matches.get(seen.number, 0),
                core.worn_clock(who=seen.number),
            )
        return out


_NO_VIEW = WornView(np.empty((0, 0), np.uint8), np.eye(4), np.eye(6))
_NOBODY = Overlap(0, _NO_VIEW, _NO_VIEW, float("nan"))
"""In the place of a view, where none came."""

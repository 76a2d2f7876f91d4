"""Map management (METHOD 7.8): enough features in view, candidates for later ones, none that keep failing."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from collabslam._core import Filter, UpdateReport
from collabslam.settings.table import Settings
from collabslam.slam.map_change import ImagePoints, MapChange
from collabslam.slam.start import Start
from collabslam.slam.targets.in_map import PrintedTargets
from collabslam.slam.tracking.depth_input import Depths
from collabslam.slam.tracking.tracks import TrackingResult
from collabslam.slam.usual_speed import UsualSpeed
from collabslam.slam.view import View
from collabslam.slam.worn.overlaps import Overlaps
from collabslam.types import Array, Ids


@dataclass(frozen=True)
class _Observed:
    """What became of candidates: the feature of each that became one, how far off its arc each was that did
    not, ids of those held in their places (`CandidateReport`), and pixels of those fixed to the camera."""

    delayed: dict[int, int]
    off_arc: Array
    held: Ids
    fixed: Array


def scarce_below(settings: Settings) -> int:
    """With fewer features than this the view runs out of them."""
    return round(settings.filter.map.in_view * settings.filter.birth.vague_below)


class MapManager:
    """Lets the filter grow and prune its map; what came of it is returned, and kept nowhere else.

    Parameters
    ----------
    core : Filter
    settings : Settings
    printed : PrintedTargets
        Printed targets that come into view.
    start : Start
        How the map begins.
    usual : UsualSpeed
        What the map has its size from where nothing else tells it.
    """

    def __init__(
        self, core: Filter, settings: Settings, printed: PrintedTargets, start: Start, usual: UsualSpeed
    ) -> None:
        self._filter, self._printed, self._start, self._usual = core, printed, start, usual
        self.in_view = settings.filter.map.in_view
        self._reserve = round(self.in_view * settings.filter.map.reserve)
        mode = settings.filter.estimator.mode
        self._undelayed = mode == "mono-undelayed"
        self._vague_below = scarce_below(settings)
        if mode.startswith("mono"):
            # Features of unknown depth say little about the scale, and without Cf nothing else would: metres
            # would be their guess.  An arbitrary unit drifts, which is less than not to know where one is.
            least = 2 * settings.filter.lost.min_matches
            self._vague_below = 0 if start.metric else min(least, self._vague_below)

    def missing(self, found: TrackingResult) -> int:
        """How many features the view lacks."""
        return max(0, self.in_view - len(found.ids))

    def grow(
        self, view: View, found: TrackingResult, overlap: Overlaps, depths: Depths, report: UpdateReport
    ) -> MapChange:
        """After an update that was accepted: births with depth first, then others as the view lacks them."""
        instant, used = overlap.births(report, view.t)
        earlier = overlap.earlier_births(report, self._filter, view.t)
        measured = depths.births(report)
        self._filter.drop_candidates(np.concatenate([found.lost, used]))
        observed = self._observe(found, used)
        delayed = observed.delayed
        deleted = self._filter.manage_map(self._printed.kept())
        instant = instant.with_more(self._printed.births() if self._filter.started else ImagePoints())
        matched = report.bearings.accepted.sum() + len(instant) + len(earlier) + len(measured) + len(delayed)
        alike = self._usual.doubts(view.t)
        promoted = self._promote_oldest(found, observed.held, self._vague_below - int(matched), alike=alike)
        waiting = np.isin(found.candidates, self._filter.candidates)
        kept = ~np.isin(found.ids, deleted)
        became = np.isin(found.candidates, [*delayed, *promoted])
        taken = [found.uv[kept], instant.uv, measured.uv, found.candidate_uv[waiting | became]]
        if self._filter.started:
            known, here = int(report.bearings.accepted.sum()), np.concatenate(taken)
            others = self._start.others(view, here, self.in_view - len(here), known)
            undelayed, candidates = self._begin_others(view, np.concatenate([here, others.uv]))
            begun = MapChange(instant.with_more(others), undelayed=undelayed, candidates=candidates)
        else:
            begun = self._start.begin(view, instant, self.in_view)
        return replace(
            begun,
            measured=measured,
            delayed=delayed,
            promoted=promoted,
            earlier=earlier,
            deleted=deleted,
            off_arc=observed.off_arc,
            fixed=observed.fixed,
        )

    def begin(self, view: View, overlap: Overlaps, report: UpdateReport) -> MapChange:
        """After a restart: the features that the new map begins with, and candidates beside them."""
        instant, _ = overlap.births(report, view.t)
        undelayed, candidates = self._begin_others(view, instant.uv)
        return MapChange(instant, undelayed=undelayed, candidates=candidates)

    def hold(self, view: View, found: TrackingResult) -> MapChange:
        """Leaves the map alone, as nobody knows where the camera is; candidates that were lost are dropped.

        All of them are if the camera was lost before: it may not have been where they say it was.
        """
        self._filter.drop_candidates(self._filter.candidates if view.lost else found.lost)
        return MapChange()

    def forget(self, ids: Ids, change: MapChange) -> MapChange:
        """Deletes features that are wrong: those found, where what they show is not at rest or of another
        size (METHOD 28), or all that were searched, where a printed target alone fits the map (METHOD 17)."""
        there = np.intersect1d(ids, self._filter.features)
        gone = np.setdiff1d(there, [*change.deleted, *self._printed.kept()])
        self._filter.remove_features(gone)
        return replace(change, deleted=np.concatenate([change.deleted, gone]))

    def _observe(self, found: TrackingResult, used: Ids) -> _Observed:
        """Candidates that were found, but for those that births with depth use up."""
        rest = ~np.isin(found.candidates, used)
        ids, uv = found.candidates[rest], found.candidate_uv[rest]
        report = self._filter.observe_candidates(ids, uv)
        off_arc = report.off_arc[report.off_arc > 0.0]
        return _Observed(_by_candidate(ids, report.born), off_arc, ids[report.held], uv[report.fixed])

    def _promote_oldest(self, found: TrackingResult, held: Ids, count: int, *, alike: bool) -> dict[int, int]:
        """Where the view runs out of features, candidates that waited longest wait no longer.

        Those that the image has ``held`` in their places may be fixed to the camera.  Depths that are
        ``alike`` say less of the map's size.
        """
        waiting = np.setdiff1d(np.intersect1d(found.candidates, self._filter.candidates), held)
        ids = waiting[: max(count, 0)]
        return _by_candidate(ids, self._filter.promote_candidates(ids, alike=alike))

    def _begin_others(self, view: View, taken: Array) -> tuple[ImagePoints, ImagePoints]:
        """Undelayed features, or else candidates, where the view lacks points besides those ``taken``."""
        wait = not self._undelayed
        lacking = self.in_view + (self._reserve if wait else 0) - len(taken)
        if lacking < self.in_view // 8:
            return ImagePoints(), ImagePoints()
        uv = view.corners.pick(taken, lacking)
        if wait:
            return ImagePoints(), ImagePoints(self._filter.add_candidates(uv), uv)
        return ImagePoints.born(self._filter.add_undelayed(uv), uv), ImagePoints()


def _by_candidate(candidates: Ids, features: Ids) -> dict[int, int]:
    """Feature by candidate; -1 is none."""
    pairs = zip(candidates.tolist(), features.tolist(), strict=True)
    return {candidate: feature for candidate, feature in pairs if feature >= 0}

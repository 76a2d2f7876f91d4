"""Whether what is behind an outline is seen through it: then nobody wears that camera (METHOD 29)."""

from __future__ import annotations

import numpy as np

from collabslam._core import Camera, Filter, Prediction
from collabslam.frontend.patch import warp_templates
from collabslam.frontend.search import FOUND, GATE, active_search
from collabslam.frontend.viewed_points import ViewedPoints
from collabslam.frontend.wearer_mask import Outline
from collabslam.settings.table import Settings
from collabslam.slam.tracking.tracks import TrackingResult, Tracks
from collabslam.slam.view import View
from collabslam.slam.worn.matcher import MIN_POINTS, WornMatcher
from collabslam.slam.worn.overlap import Overlap
from collabslam.slam.worn.wearers import SURE, Wearers
from collabslam.types import Ids

_WIDEST = 12.0
"""Pixels; in a wider ellipse something that looks alike may be found on a body."""
_IN_MAP, _IN_CF = 0.3, 0.02
"""Share of landmarks that are found on a body in whose place they are not, and of corners on it in Cf."""
_ONCE = 0.5 * SURE
"""What the landmarks of one frame add at most."""
_CORNERS, _ELSEWHERE = 30, 100
"""Corners on an outline, and others, that are looked for in Cf."""


class SeenThrough:
    """Asks in each frame whether landmarks, or new corners, show behind the outlines in view.

    Parameters
    ----------
    core : Filter
    camera : Camera
        Cs.
    tracks : Tracks
    matcher : WornMatcher
    wearers : Wearers
        Is told.
    settings : Settings
    """

    def __init__(
        self,
        core: Filter,
        camera: Camera,
        tracks: Tracks,
        matcher: WornMatcher,
        wearers: Wearers,
        settings: Settings,
    ) -> None:
        self._filter, self._camera, self._tracks, self._matcher = core, camera, tracks, matcher
        self._wearers, self._settings = wearers, settings

    def ask_map(self, view: View, found: TrackingResult) -> None:
        """Before the update: whether the map's landmarks behind an outline are where they should be."""
        usual = float(found.hit.mean()) if len(found.searched) >= MIN_POINTS else 0.0
        if not view.wearers or view.lost or usual == 0.0:
            return
        expected = self._filter.predict_pixels()
        spread = GATE**2 * expected.s.diagonal(axis1=1, axis2=2).max(axis=1, initial=0.0)
        for who, outline in view.wearers.items():
            behind = self._wearers.behind(outline, expected.uv, expected.rho, expected.rho_sd)
            ids = expected.ids[behind & (spread < _WIDEST**2)]
            tried, hits = (
                self._found_again(found, ids)
                if who in self._wearers.nobody
                else self._look(view, expected.subset(np.isin(expected.ids, ids)))
            )
            self._wearers.saw(who, found=hits, tried=tried, usual=usual, by_chance=_IN_MAP, at_once=_ONCE)

    def ask_worn(self, view: View) -> None:
        """Whether a worn camera sees what shows on its wearer's outline, as long as that is not known.

        Before the filter starts, too: it rests on what the first view gives.
        """
        undecided = self._wearers.undecided(view.wearers)
        for overlap in () if view.lost else view.worn:
            who, given = overlap.worn.who, overlap.given
            if who in undecided and (given is overlap.worn or given.t is None or given.t == view.t):
                self._match(view, undecided[who], overlap)

    def _match(self, view: View, outline: Outline, overlap: Overlap) -> None:
        regions = self._matcher.regions(overlap)
        on_it = view.corners.strongest(lambda uv: outline.trunk(self._camera, uv), _CORNERS)
        if regions is None or not len(on_it):
            return
        others = view.corners.pick(np.empty((0, 2)), _ELSEWHERE)
        points = ViewedPoints(np.concatenate([on_it, others]))
        matches = self._matcher.matches(view, overlap.worn, regions, points)
        hits = int(np.sum(matches.index < len(on_it)))
        usual = (len(matches.index) - hits) / max(len(others), 1)
        self._wearers.saw(overlap.worn.who, found=hits, tried=len(on_it), usual=usual, by_chance=_IN_CF)

    def _look(self, view: View, expected: Prediction) -> tuple[int, int]:
        """Looks for landmarks that are not searched otherwise: how many could be found, and how many were."""
        if not len(expected.ids):
            return 0, 0
        patches = [self._tracks.patch(i) for i in expected.ids.tolist()]
        pose, options = self._filter.pose, self._settings.frontend
        warped = warp_templates(self._camera, patches, pose, expected.points, options.patch)
        there = expected.subset(warped.ok)
        result = active_search(
            view.image, warped.templates[warped.ok], there.uv, there.s, None, options.search
        )
        return len(there.ids), int(np.sum(result.code == FOUND))

    @staticmethod
    def _found_again(found: TrackingResult, ids: Ids) -> tuple[int, int]:
        """The same of landmarks that were searched with all others."""
        rows = np.isin(found.searched, ids)
        return int(rows.sum()), int(found.hit[rows].sum())

"""New features of a frame, and the candidates for those of later ones (METHOD 5, and 7.8)."""

from __future__ import annotations

import numpy as np

from collabslam._core import Filter, UpdateReport
from collabslam.frontend.detect import Corners
from collabslam.settings.table import Settings
from collabslam.slam.depth_input import Depths
from collabslam.slam.tracks import Found, Tracks
from collabslam.slam.worn_frame import Overlap
from collabslam.types import Ids, Image, Mask

BIRTHS = ("births_instant", "births_depth", "births_delayed", "births_undelayed")
"""Kinds of birth, as diagnostics count them."""


class Births:
    """Keeps enough features in view.

    Parameters
    ----------
    core : Filter
    tracks : Tracks
    corners : Corners
        Of the frame's image of Cs.
    settings : Settings
    scale_free : bool
        Whether the map begins with features of vague depth.
    """

    def __init__(
        self, core: Filter, tracks: Tracks, corners: Corners, settings: Settings, *, scale_free: bool
    ) -> None:
        self._filter, self._tracks, self._corners = core, tracks, corners
        self._scale_free = scale_free
        self.in_view = int(settings["filter.map.in_view"])
        self._reserve = round(self.in_view * float(settings["filter.map.reserve"]))
        self._vague_below = round(self.in_view * float(settings["filter.birth.vague_below"]))
        self._undelayed = settings["filter.estimator.mode"] == "mono-undelayed"

    def missing(self, found: Found) -> int:
        """How many features the view lacks."""
        return max(0, self.in_view - len(found.ids))

    def with_depth(
        self, image: Image, found: Found, overlap: Overlap, depths: Depths, report: UpdateReport
    ) -> dict[str, int]:
        """Takes over features born with depth, and lets candidates with parallax be born; their numbers."""
        pose = self._filter.pose
        instant, used = overlap.births(report)
        self._tracks.add_features(image, pose, instant, overlap.uv_of(report))
        measured, uv = depths.births(report)
        self._tracks.add_features(image, pose, measured, uv)
        self._filter.drop_candidates(np.concatenate([found.lost, used]))
        ids, uv = found.candidates, found.candidate_uv
        if len(used):
            waiting = ~np.isin(ids, used)
            ids, uv = ids[waiting], uv[waiting]
        _, features = self._filter.observe_candidates(ids, uv)
        return {
            "births_instant": len(instant),
            "births_depth": len(measured),
            "births_delayed": int(self._promoted(ids, features).sum()),
        }

    def first(self, image: Image, overlap: Overlap, report: UpdateReport) -> dict[str, int]:
        """Takes over the features that a map begins with, and starts candidates beside them."""
        born, _ = overlap.births(report)
        self._tracks.add_features(image, self._filter.pose, born, overlap.uv_of(report))
        return {
            **dict.fromkeys(BIRTHS, 0),
            "births_instant": len(born),
            "births_undelayed": self.start_others(image),
        }

    def vague(self, tracked: int) -> int:
        """Where the view runs out of features, those who waited longest wait no longer."""
        ids = self._tracks.waiting(self._vague_below - tracked)
        return int(self._promoted(ids, self._filter.promote_candidates(ids)).sum())

    def start_others(self, image: Image) -> int:
        """Starts candidates where the view lacks points, or undelayed features; the number of these."""
        scale_free = not self._filter.started and self._scale_free
        if not (self._filter.started or scale_free):
            return 0
        pixels = self._tracks.pixels
        wait = not (self._undelayed or scale_free)
        lacking = self.in_view + (self._reserve if wait else 0) - len(pixels)
        if lacking < self.in_view // 8:
            return 0
        uv = self._corners.pick(pixels, lacking)
        pose = self._filter.pose
        if wait:
            ids = self._filter.add_candidates(uv)
            self._tracks.add_candidates(image, pose, ids, uv)
            return 0
        ids = self._filter.add_undelayed(uv)
        good = ids >= 0
        self._tracks.add_features(image, pose, ids[good], uv[good])
        return int(good.sum())

    def _promoted(self, candidates: Ids, features: Ids) -> Mask:
        """Notes which candidates became features, -1 for those that did not; True for those that did."""
        for candidate, feature in zip(candidates.tolist(), features.tolist(), strict=True):
            if feature >= 0:
                self._tracks.promote(candidate, feature)
        return np.asarray(features >= 0)

"""The worn camera in one frame: is there overlap, which points do both cameras see (METHOD 7.4 and 9)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from collabslam._core import Camera, Filter, UpdateReport, WornMeasurement
from collabslam.errors import InputError
from collabslam.frontend.detect import Hidden
from collabslam.frontend.patch import Patch, capture
from collabslam.frontend.two_views import TwoViews, ViewedPoints
from collabslam.frontend.wearer_mask import covered
from collabslam.frontend.worn_match import WornMatches, match_worn
from collabslam.images import check_grey
from collabslam.settings.frontend import FrontendSettings
from collabslam.settings.table import Settings
from collabslam.slam.map_change import ImagePoints
from collabslam.slam.state import SECONDS
from collabslam.slam.tracks import Found
from collabslam.slam.view import View
from collabslam.types import Array, Ids, WornView


@dataclass(frozen=True)
class Overlap:
    """Matches between Cs and Cf, ready for the filter.

    Attributes
    ----------
    ids : (M,) int64
        Feature of each pair, -1 for a new point.
    candidates : (M,) int64
        Candidate that the new point was until now, -1 for none.
    uv, uv_f : (M, 2) float64
        Pixels in Cs and Cf.
    worn : WornView or None
        None where there is no overlap, or it was refused.
    matches : WornMatches or None
    against : float
        How much the view contradicts T_CF, above 1 beyond its covariance: the images do (`Verdict`), or the
        map does; NaN where neither says anything.
    refused : bool
        The view contradicts T_CF or the map: it is not used.
    baseline : float
        |t_CF|, metres; NaN without overlap.
    view : View or None
        The frame that the matches are of, where the view of Cf was taken at another time than the frame's.
    """

    ids: Ids = field(default_factory=lambda: np.empty(0, np.int64))
    candidates: Ids = field(default_factory=lambda: np.empty(0, np.int64))
    uv: Array = field(default_factory=lambda: np.empty((0, 2)))
    uv_f: Array = field(default_factory=lambda: np.empty((0, 2)))
    worn: WornView | None = None
    matches: WornMatches | None = None
    points: int = 0
    against: float = float("nan")
    refused: bool = False
    baseline: float = float("nan")
    view: View | None = None

    @property
    def observation(self) -> WornMeasurement | None:
        """The argument ``worn`` of :meth:`Filter.update`."""
        if self.worn is None:
            return None
        worn, capture = self.worn, None
        if worn.t is not None and self.view is not None:
            capture = (worn.t, self.view.t)
        return WornMeasurement(
            worn.t_cf, worn.covariance, self.ids, self.uv, self.uv_f, bias=worn.bias, capture=capture
        )

    def births(self, report: UpdateReport, t: float) -> tuple[ImagePoints, Ids]:
        """Features born from pairs of the frame at ``t``, and the candidates (C,) that births use up."""
        if self.worn is None:
            return ImagePoints(), np.empty(0, np.int64)
        used = self.candidates[report.pairs.born >= 0]
        earlier = self.view is not None and self.view.t != t
        born = ImagePoints() if earlier else ImagePoints.born(report.pairs.born, self.uv)
        return born, used[used >= 0]

    def earlier_births(self, report: UpdateReport, core: Filter, t: float) -> dict[int, Patch]:
        """Features born from pairs of a frame before the one at ``t``, with their patches from there."""
        if self.view is None or self.view.t == t:
            return {}
        born = ImagePoints.born(report.pairs.born, self.uv)
        patches = capture(self.view.image, born.uv, core.kept_pose(self.view.t))
        return dict(zip(born.ids.tolist(), patches, strict=True))

    def counts(self, report: UpdateReport) -> dict[str, Any]:
        """Diagnostics of the worn camera."""
        rejected = self.matches.rejected if self.matches else {}
        verdict = self.matches.verdict if self.matches else None
        correction = np.full(6, np.nan) if verdict is None else verdict.correction
        pairs = report.pairs
        return {
            "overlap": int(self.worn is not None),
            "baseline_m": self.baseline,
            "cf_refused": int(self.refused),
            "t_cf_correction_m": float(np.linalg.norm(correction[:3])),
            "t_cf_correction_deg": float(np.degrees(np.linalg.norm(correction[3:]))),
            "t_cf_against": self.against,
            "cf_points": self.points,
            "cf_matches": len(self.ids),
            "cf_rejected_region": rejected.get("region", 0),
            "cf_rejected_ratio": rejected.get("ratio", 0) + rejected.get("mutual", 0),
            "cf_rejected_epipolar": rejected.get("epipolar", 0) + rejected.get("consensus", 0),
            "cf_rejected_low_score": rejected.get("score", 0),
            "cf_rejected_chi2": pairs.rejected_gate,
            "cf_rejected_hohct": pairs.rejected_batch,
            "cf_rejected_conditional": pairs.rejected_conditional,
            "cf_too_uncertain": pairs.too_uncertain,
            "depth_rows": pairs.depth_rows,
            "cf_pixel_rows": pairs.pixel_rows,
        }


NEW_POINTS = 120
"""Most new corners of Cs that are tried in Cf."""
_TRIES = 6  # new corners tried for each feature that the view lacks
_BY_MAP = 10.0
"""`Overlap.against` where it is the map that contradicts T_CF."""
_MIN_KNOWN = 0.2
"""Least share of the map's points matched in Cf, relative to that of new points; where new ones match and
those of the map do not, T_CF contradicts the map and the view is not used."""
MIN_POINTS = 5
"""Points tried, and matched, from which on shares of them mean something."""


def _against(matches: WornMatches) -> float:
    """How much the images contradict T_CF; NaN where they say nothing."""
    return float("nan") if matches.verdict is None else matches.verdict.against


class WornMatcher:
    """Decides whether Cf helps in a frame, and matches it to Cs."""

    def __init__(
        self,
        core: Filter,
        camera: Camera,
        worn_camera: Camera | None,
        settings: Settings,
        options: FrontendSettings,
    ) -> None:
        self._filter = core
        self._camera = camera
        self._worn_camera = worn_camera
        self._options = options
        mode = str(settings["filter.estimator.mode"])
        self._only_start = mode.startswith("mono")
        self._only_births = mode == "collab-init"

    @property
    def is_there(self) -> bool:
        """Whether there may be views of Cf."""
        return self._worn_camera is not None

    def checked(self, worn: WornView | None) -> WornView | None:
        """As `require`, where there is a view."""
        return None if worn is None else self.require(worn)

    def require(self, worn: WornView) -> WornView:
        """The worn view; raises InputError if it does not fit its calibration, or can be of no time."""
        camera = self._worn_camera
        if camera is None:
            raise InputError("there is a worn view but no worn_camera; give the calibration of Cf.")
        image = check_grey(worn.image, camera, "worn image")
        self._filter.check_worn(worn.t_cf, worn.covariance, worn.bias)
        try:
            np.linalg.cholesky(worn.covariance)
        except np.linalg.LinAlgError as error:
            raise InputError(
                "the covariance of T_CF is singular; give every direction a standard deviation."
            ) from error
        if worn.t is not None and not abs(worn.t) <= SECONDS:
            raise InputError(f"the worn view's time is {worn.t}; give seconds, by the clock of Cs's stamps.")
        return replace(worn, image=image)

    def hidden(self, worn: WornView | None) -> Hidden | None:
        """Which pixels of Cs show whoever wears Cf; None where that is nobody, or nobody knows."""
        radius = self._options.worn.body_radius
        if worn is None or radius == 0.0:
            return None
        return lambda uv: covered(self._camera, uv, worn.t_cf, radius)

    def match(self, view: View, found: Found, missing: int) -> Overlap:
        """Pairs of this frame; known features first, then as many new points as the view is missing."""
        worn, started = view.worn, view.started
        if worn is None or self._worn_camera is None or (started and self._only_start):
            return Overlap()
        overlap = self._filter.predict_overlap(worn.t_cf, worn.covariance)
        if overlap is None:
            return Overlap()
        known = np.empty(0, np.int64) if self._only_births and started else np.flatnonzero(found.hit)
        known_uv = found.result.uv[known]
        taken = np.concatenate([found.uv, found.candidate_uv])
        tries = min(NEW_POINTS, _TRIES * missing)
        fresh = view.corners.pick(taken, tries)
        uv = np.concatenate([known_uv, found.candidate_uv, fresh])
        unknown = np.full(len(found.candidate_uv) + len(fresh), np.nan)
        views = TwoViews(
            view.image,
            self._camera,
            worn.image,
            self._worn_camera,
            worn.t_cf,
            worn.covariance,
            overlap.roi_s,
            overlap.roi_f,
        )
        points = ViewedPoints(
            uv,
            np.concatenate([found.rho[known], unknown]),
            np.concatenate([found.rho_sd[known], unknown]),
        )
        matches = match_worn(views, points, self._options)
        against = _BY_MAP if self._contradicts(len(known), len(uv), matches) else _against(matches)
        # A start rests on this one view alone: it needs one that the images confirm.
        unsure = not started and np.isnan(against)
        if against > 1.0 or unsure:
            return Overlap(
                matches=matches,
                points=len(uv),
                against=against,
                refused=not unsure,
                baseline=overlap.baseline,
            )
        ids = np.concatenate([found.searched[known], np.full(len(unknown), -1)])
        candidates = np.concatenate([np.full(len(known), -1), found.candidates, np.full(len(fresh), -1)])
        chosen = self._choose(ids[matches.index], matches, missing)
        rows = matches.index[chosen]
        return Overlap(
            ids=ids[rows].astype(np.int64),
            candidates=candidates[rows].astype(np.int64),
            uv=uv[rows],
            uv_f=matches.uv_f[chosen],
            worn=view.captured or worn,
            matches=matches,
            points=len(uv),
            against=against,
            baseline=overlap.baseline,
            view=None if view.captured is None else view,
        )

    def _contradicts(self, known: int, tried: int, matches: WornMatches) -> bool:
        """Whether new points match and the map's do not, so that T_CF cannot be right for both.

        The map's points come first; they are searched at their depth, new ones along their whole line.
        """
        of_map = int(np.sum(matches.index < known))
        new = len(matches.index) - of_map
        if known < MIN_POINTS or new < MIN_POINTS:
            return False
        min_share = _MIN_KNOWN * new / (tried - known)
        return of_map < min_share * known

    @staticmethod
    def _choose(ids: Ids, matches: WornMatches, missing: int) -> Ids:
        """All matches of known features, and the best new ones up to the number that is missing."""
        new = np.flatnonzero(ids < 0)
        best = new[np.argsort(-matches.score[new], kind="stable")[:missing]]
        return np.sort(np.concatenate([np.flatnonzero(ids >= 0), best]))

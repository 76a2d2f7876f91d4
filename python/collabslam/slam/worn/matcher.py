"""The worn camera in one frame: is there overlap, which points do both cameras see (METHOD 7.4 and 9)."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Real

import numpy as np

from collabslam._core import LAST_TIME, Camera, Filter, OverlapPrediction
from collabslam.errors import InputError
from collabslam.frontend.detect import hidden_by_any
from collabslam.frontend.mask import StaticMask
from collabslam.frontend.viewed_points import ViewedPoints
from collabslam.frontend.worn_match import WornMatches, match_worn
from collabslam.images import check_grey
from collabslam.settings.table import Settings
from collabslam.slam.tracking.tracks import TrackingResult
from collabslam.slam.view import View
from collabslam.slam.worn.overlap import Overlap
from collabslam.slam.worn.wearers import Wearers
from collabslam.types import Array, Ids, Masks, WornView

NEW_POINTS = 120
"""Most new corners of Cs that are tried in Cf."""
_TRIES = 6  # new corners tried for each feature that the view lacks
_BY_MAP = 10.0
"""`Overlap.against` where it is the map that contradicts T_CF."""
_MIN_KNOWN = 0.2
"""Least share of the map's points matched in Cf, relative to that of new points; where new ones match and
those of the map do not, T_CF contradicts the map and the view is not used."""
SUREST = 1e-4
"""Metres and radians: no sensor tells T_CF surer than that in any direction, but drivers write such
placeholders where they know nothing."""
FLOOR = 1e-3
"""What is taken in place of one: the standard deviation of a good sensor, metres and radians."""
MIN_POINTS = 5
"""Points tried, and matched, from which on shares of them mean something."""


def _against(matches: WornMatches) -> float:
    """How much the images contradict T_CF; NaN where they say nothing."""
    return float("nan") if matches.verdict is None else matches.verdict.against


class WornMatcher:
    """Decides whether Cf helps in a frame, and matches it to Cs.

    Parameters
    ----------
    core : Filter
    camera : Camera
        Cs.
    worn_cameras : dict
        Each Cf by its name, in the order in which the filter numbers them.
    settings : Settings
    masks : Masks
        Of those worn cameras that have one.
    wearers : Wearers
        Who is in view.
    """

    def __init__(
        self,
        core: Filter,
        camera: Camera,
        worn_cameras: Mapping[str, Camera],
        settings: Settings,
        masks: Masks,
        wearers: Wearers,
    ) -> None:
        self._wearers = wearers
        self._masks = {name: StaticMask(mask).hides for name, mask in masks.worn.items()}
        self._filter = core
        self._camera = camera
        self._worn_cameras = worn_cameras
        self._told = False
        self._numbers = {name: number for number, name in enumerate(worn_cameras)}
        self._settings = settings
        mode = settings.filter.estimator.mode
        self._only_start = mode.startswith("mono")
        self._only_births = mode == "collab-init"
        self.measures_pixels = mode == "collab-tight"
        """Whether features are measured by their pixel in Cf, so that Cs need not see them."""

    @property
    def is_there(self) -> bool:
        """Whether there may be views of Cf."""
        return bool(self._worn_cameras)

    def number(self, who: str) -> int:
        """The filter's number of a worn camera that `require` knows."""
        return self._numbers[who]

    def checked(self, views: Sequence[WornView]) -> tuple[WornView, ...]:
        """The views of one frame, one of each worn camera, each as `require` has it."""
        if not isinstance(views, Sequence):
            raise InputError(f"the views are {type(views).__name__}; give a list of WornView.")
        for view in views:
            if not isinstance(view, WornView) or not isinstance(view.who, str):
                raise InputError(f"A {type(view).__name__} is no view; give WornView, with a name as who.")
        names = [view.who for view in views]
        if len(set(names)) != len(names):
            raise InputError("a frame takes one view of each worn camera; give later ones to add_worn.")
        return tuple(self.require(view) for view in views)

    def require(self, worn: WornView) -> WornView:
        """The worn view; raises InputError if it does not fit its calibration, or can be of no time."""
        if not self._worn_cameras:
            raise InputError("there is a worn view but no worn_camera; give the calibration of Cf.")
        camera = self._worn_cameras.get(worn.who)
        if camera is None:
            known = ", ".join(repr(name) for name in self._worn_cameras)
            raise InputError(f"there is no worn camera {worn.who!r}; WornView.who is one of {known}.")
        image = check_grey(worn.image, camera, "worn image")
        self._filter.check_worn(worn.t_cf, worn.covariance, worn.bias, who=self.number(worn.who))
        if worn.rate is not None:
            self._filter.check_gyro(worn.rate)
        try:
            np.linalg.cholesky(worn.covariance)
        except np.linalg.LinAlgError as error:
            raise InputError(
                "the covariance of T_CF is singular; give every direction a standard deviation."
            ) from error
        if worn.t is not None and not (isinstance(worn.t, Real) and abs(worn.t) <= LAST_TIME):
            raise InputError(f"the worn view's time is {worn.t}; give seconds, by the clock of Cs's stamps.")
        rate = None if worn.rate is None else np.array(worn.rate, np.float64)
        return replace(worn, image=image, covariance=self._floored(worn.covariance), rate=rate)

    def _floored(self, covariance: Array) -> Array:
        """The covariance of T_CF; with a floor where it is surer than any sensor, which is told once."""
        parts = (covariance[:3, :3], covariance[3:, 3:])
        surest = min(float(np.linalg.eigvalsh(part)[0]) for part in parts)
        if surest > SUREST**2:
            return covariance
        if not self._told:
            self._told = True
            warnings.warn(
                f"T_CF is stated surer than any sensor (a deviation of {max(surest, 0.0) ** 0.5:.1e} "
                f"m or rad): {FLOOR} m and rad are added; state what it errs by.",
                stacklevel=2,
            )
        return covariance + FLOOR**2 * np.eye(6)

    def match(
        self,
        view: View,
        overlap: Overlap,
        found: TrackingResult,
        missing: int,
        before: Sequence[Overlap] = (),
    ) -> Overlap:
        """Pairs of a worn camera's view with a frame: known features first, then new points.

        Of the new ones those are taken that other worn cameras begin in the same frame, as ``before`` says,
        and as many more as the frame is ``missing`` then.
        """
        worn, started = overlap.worn, view.started
        if started and self._only_start:
            return overlap
        regions = self.regions(overlap)
        if regions is None:
            return overlap
        known = np.empty(0, np.int64) if self._only_births and started else np.flatnonzero(found.hit)
        known_uv = found.result.uv[known]
        taken = np.concatenate([found.uv, found.candidate_uv])
        tries = min(NEW_POINTS, _TRIES * missing)
        fresh = view.corners.pick(taken, tries)
        uv = np.concatenate([known_uv, found.candidate_uv, fresh])
        unknown = np.full(len(found.candidate_uv) + len(fresh), np.nan)
        points = ViewedPoints(
            uv,
            np.concatenate([found.rho[known], unknown]),
            np.concatenate([found.rho_sd[known], unknown]),
        )
        matches = self.matches(view, worn, regions, points)
        against = _BY_MAP if self._contradicts(len(known), len(uv), matches) else _against(matches)
        # A start rests on this one view alone: it needs one that the images confirm.
        unsure = not started and np.isnan(against)
        if against > 1.0 or matches.size > 1.0 or unsure:
            return replace(
                overlap,
                matches=matches,
                points=len(uv),
                against=against,
                size=matches.size,
                refused=not unsure,
                baseline=regions.baseline,
            )
        ids = np.concatenate([found.searched[known], np.full(len(unknown), -1)])
        candidates = np.concatenate([np.full(len(known), -1), found.candidates, np.full(len(fresh), -1)])
        begun = _begun(overlap.at, uv, candidates, before)
        most = missing - len({tuple(point) for o in before for point in o.uv[o.ids < 0].tolist()})
        chosen = self._choose(ids[matches.index], begun[matches.index], matches, most)
        rows = matches.index[chosen]
        return replace(
            overlap,
            measured=True,
            ids=ids[rows].astype(np.int64),
            candidates=candidates[rows].astype(np.int64),
            uv=uv[rows],
            uv_f=matches.uv_f[chosen],
            matches=matches,
            points=len(uv),
            against=against,
            size=matches.size,
            baseline=regions.baseline,
        )

    def regions(self, overlap: Overlap) -> OverlapPrediction | None:
        """Where in both images a view and its frame may show the same; None where they cannot."""
        worn = overlap.worn
        return self._filter.predict_overlap(worn.t_cf, worn.covariance, who=overlap.number)

    def matches(
        self, view: View, worn: WornView, regions: OverlapPrediction, points: ViewedPoints
    ) -> WornMatches:
        """Points of a frame in a worn camera's view."""
        hiding = [self._masks.get(worn.who), *self._wearers.hidden_from(worn.who, worn.t_cf, view.wearers)]
        return match_worn(
            view.image,
            worn,
            points,
            (self._camera, self._worn_cameras[worn.who]),
            self._settings,
            regions=(regions.roi_s, regions.roi_f),
            hidden=hidden_by_any(hiding),
        )

    def _contradicts(self, known: int, tried: int, matches: WornMatches) -> bool:
        """Whether new points match and the map's do not, so that T_CF cannot be right for both.

        The map's points come first; they are searched at their depth, new ones along their whole line.
        """
        of_map = int(np.sum(matches.index < known))
        new = len(matches.index) - of_map
        if matches.landmarks < MIN_POINTS or new < MIN_POINTS:
            return False
        min_share = _MIN_KNOWN * new / (tried - known)
        return of_map < min_share * matches.landmarks

    @staticmethod
    def _choose(ids: Ids, begun: Ids, matches: WornMatches, most: int) -> Ids:
        """All matches of known features and of points that another view begins, and the best of the other
        new ones, at most so many."""
        shared = (ids < 0) & (begun == SHARED)
        new = np.flatnonzero((ids < 0) & (begun == FREE))
        best = new[np.argsort(-matches.score[new], kind="stable")[: max(0, most)]]
        return np.sort(np.concatenate([np.flatnonzero((ids >= 0) | shared), best]))


FREE, SHARED, ELSEWHERE = 0, 1, 2
"""Of a new point: nobody has it, another view begins it in the same frame, or in another one."""


def _begun(t: float, uv: Array, candidates: Ids, before: Sequence[Overlap]) -> Ids:
    """(N,) which of `FREE`, `SHARED` and `ELSEWHERE` each new point of the frame at ``t`` is."""
    out = np.full(len(uv), FREE)
    for overlap in before:
        new = overlap.ids < 0
        if overlap.at != t:
            out[np.isin(candidates, overlap.candidates[new]) & (candidates >= 0)] = ELSEWHERE
        elif new.any():
            same = (uv[:, None] == overlap.uv[new][None]).all(axis=2).any(axis=1)
            out[same] = SHARED
    return out

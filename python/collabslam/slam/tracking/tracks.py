"""What the front end remembers between frames: patches of features and candidates, and their last pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from collabslam._core import LAST_TIME, Camera, ConditionalPrediction, Prediction, SearchResult
from collabslam.formats.schema import (
    Check,
    array,
    fields,
    flag,
    instance,
    items,
    number,
    optional,
    refuse,
    table,
    whole,
)
from collabslam.frontend.flow import MAX_ERROR, FlowImage, flow_guess, motion_of
from collabslam.frontend.patch import Patch, capture, warp_templates
from collabslam.frontend.search import FOUND, GATE, OUTSIDE, WIDE, active_search, wide_ellipses
from collabslam.settings.frontend import FrontendSettings
from collabslam.slam.map_change import ImagePoints, MapChange, Recovered
from collabslam.slam.state import PATCH, PersistentState, check_pixel
from collabslam.slam.view import View
from collabslam.types import Array, Ids, Image, Mask

ExpectGiven = Callable[[Ids, Array, Ids], ConditionalPrediction]
"""Where features are expected, given others (ids and pixels) that were found."""

_MAX_GIVEN = 16  # found features, at most, from which the camera's motion is taken


@dataclass(frozen=True)
class TrackingResult:
    """Outcome of a frame's search in Cs.

    Attributes
    ----------
    searched : (S,) int64
        Features that were looked for.
    result : SearchResult
        One row for each of them.
    rho, rho_sd : (S,) float64
        Predicted inverse range and its standard deviation, 1/m.
    candidates : (C,) int64
        Candidates that were followed into this frame.
    candidate_uv : (C, 2) float64
        Their pixels.
    lost : (L,) int64
        Candidates that were not.
    """

    searched: Ids
    result: SearchResult
    rho: Array
    rho_sd: Array
    candidates: Ids
    candidate_uv: Array
    lost: Ids

    @classmethod
    def nothing(cls) -> TrackingResult:
        """What a search finds in a map without features."""
        none, ids, uv = np.empty(0), np.empty(0, np.int64), np.empty((0, 2))
        return cls(ids, SearchResult(uv, none, none, ids), none, none, ids, uv, ids)

    @property
    def hit(self) -> Mask:
        """(S,) bool: the feature was found."""
        return np.asarray(self.result.code == FOUND)

    @property
    def ids(self) -> Ids:
        """(N,) int64: features that were found."""
        return self.searched[self.hit]

    @property
    def uv(self) -> Array:
        """(N, 2) float64: their pixels."""
        return self.result.uv[self.hit]


def _anything(value: Any, where: str) -> None:
    """What is looked at later."""


class Tracks(PersistentState):
    """Patches and last pixels of features and candidates.

    A frame replaces these dictionaries and changes none, so that whoever holds the old ones can go back.
    Where fewer than ``scarce_below`` features were found in the last one, or most candidates were lost in it,
    weaker matches count (METHOD 7).
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_features": table(int, PATCH),
        "_candidates": table(int, PATCH),
        "_last": table(int, check_pixel),
        "_candidate_last": table(int, check_pixel),
        "_previous": optional(instance(FlowImage, image=array("|u1", None, None), factor=whole(1, 2))),
        "_previous_time": optional(number(-LAST_TIME, LAST_TIME)),
        "_low_track": flag,
    }

    def __init__(self, camera: Camera, settings: FrontendSettings, scarce_below: int) -> None:
        self._camera = camera
        self._settings = settings
        self._scarce_below = scarce_below
        self._features: dict[int, Patch] = {}
        self._candidates: dict[int, Patch] = {}
        self._last: dict[int, Array] = {}
        self._candidate_last: dict[int, Array] = {}
        self._previous: FlowImage | None = None
        self._previous_time: float | None = None
        self._low_track = False

    def state(self) -> dict[str, Any]:
        """As `PersistentState.state`; of the last image, what the flow works on."""
        last = self._previous
        return {**super().state(), "_previous": None if last is None else (last.image, last.factor)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """As `PersistentState.restore`."""
        fields(**{**self.PERSISTENT, "_previous": optional(items(_anything, 2))})(state, "Tracks")
        last: Any = state["_previous"]
        if last is not None:
            last = FlowImage.again(last[0], last[1])
        super().restore({**state, "_previous": last})
        blank = np.zeros((self._camera.height, self._camera.width), np.uint8)
        wanted = FlowImage(blank)
        if last is not None and (last.factor != wanted.factor or last.image.shape != wanted.image.shape):
            refuse("last image", "of this camera")
        if set(self._candidates) != set(self._candidate_last):
            refuse("candidates", "those that have a pixel")

    @property
    def last_image(self) -> tuple[float, FlowImage] | None:
        """The last image that was searched, and its time."""
        if self._previous is None or self._previous_time is None:
            return None
        return self._previous_time, self._previous

    def search(
        self, view: View, pose: Array, expected: Prediction, expect_given: ExpectGiven
    ) -> TrackingResult:
        """Active search of the expected features; candidates are followed into this frame (METHOD 7.3).

        A feature whose ellipse is wide, and of which the flow says nothing, is looked for last: where
        ``expect_given`` (`Filter.predict_conditional`) expects it once others have been found.  Candidates
        at pixels that are hidden are lost.
        """
        image, ids = view.image, expected.ids
        n = len(ids)
        waiting = np.array(sorted(self._candidate_last), dtype=np.int64)
        now = FlowImage(image)
        guess = self._flow(now, ids, waiting, expected)
        patches = [self._features[i] for i in ids.tolist()] + [self._candidates[i] for i in waiting.tolist()]
        points = np.concatenate([expected.points, np.full((len(waiting), 3), np.nan)])
        warped = warp_templates(self._camera, patches, pose, points, self._settings.patch)
        spread = (MAX_ERROR / GATE) ** 2 * np.eye(2)
        result = active_search(
            image,
            warped.templates,
            np.concatenate([expected.uv, guess[n:]]),
            np.concatenate([expected.s, np.broadcast_to(spread, (len(waiting), 2, 2))]),
            guess,
            self._settings.search,
            whole=False,
            scarce=self._low_track or len(self._last) < self._scarce_below,
        )
        self._search_wide(image, warped.templates, expected, result, expect_given)
        if view.hidden is not None:
            hit = result.code[:n] == FOUND
            hit[hit] = view.hidden(result.uv[:n][hit])
            result.code[:n][hit] = OUTSIDE
        seen = np.flatnonzero(warped.ok[:n])
        alive = (result.code[n:] == FOUND) & warped.ok[n:]
        if view.hidden is not None:
            alive[alive] = ~view.hidden(result.uv[n:][alive])
        found = TrackingResult(
            searched=ids[seen],
            result=result.subset(seen),
            rho=expected.rho[seen],
            rho_sd=expected.rho_sd[seen],
            candidates=waiting[alive],
            candidate_uv=result.uv[n:][alive],
            lost=waiting[~alive],
        )
        self._last = dict(zip(found.ids.tolist(), found.uv, strict=True))
        self._candidate_last = dict(zip(found.candidates.tolist(), found.candidate_uv, strict=True))
        self._previous, self._previous_time = now, view.t
        self._low_track = len(found.lost) > len(found.candidates)
        return found

    def _search_wide(
        self,
        image: Image,
        templates: Image,
        expected: Prediction,
        result: SearchResult,
        expect_given: ExpectGiven,
    ) -> None:
        """Looks for what was left for later, and again for what is not where others say; fills in ``result``.

        In a wide ellipse the flow's guess and one good peak say little: what looks alike is near everywhere.
        """
        ids, codes = expected.ids, result.code[: len(expected.ids)]
        wide = wide_ellipses(expected.s)
        if not wide.any():
            return
        found = np.flatnonzero(codes == FOUND)
        given = found[:: max(1, -(-len(found) // _MAX_GIVEN))]
        rest = np.setdiff1d(np.flatnonzero(wide & ((codes == FOUND) | (codes == WIDE))), given)
        there = expect_given(ids[given], result.uv[given], ids[rest])
        wrong = given[~there.agree & wide[given]]
        if there.agree.any() and len(wrong):
            agreed, rest = given[there.agree], np.concatenate([rest, wrong])
            there = expect_given(ids[agreed], result.uv[agreed], ids[rest])
        off = result.uv[rest] - there.uv
        distance = np.sum(off * np.linalg.solve(there.s, off[:, :, None])[:, :, 0], axis=1)
        late = (codes[rest] == WIDE) | (distance > GATE**2)
        late, there_uv, there_s = rest[late], there.uv[late], there.s[late]
        again = active_search(image, templates[late], there_uv, there_s, None, self._settings.search)
        result.uv[late], result.code[late] = again.uv, again.code
        result.score[late], result.second[late] = again.score, again.second

    def _flow(self, now: FlowImage, ids: Ids, waiting: Ids, expected: Prediction) -> Array:
        """Where optical flow says that features, and then candidates, are now; NaN where it does not say.

        Features are asked for only where the search would use the answer: in a wide ellipse.
        """
        guess = np.full((len(ids) + len(waiting), 2), np.nan)
        if self._previous is None:
            return guess
        last = [self._last.get(i) for i in ids.tolist()] + [self._candidate_last[i] for i in waiting.tolist()]
        known = np.array([k for k, uv in enumerate(last) if uv is not None], dtype=np.int64)
        before = np.reshape([uv for uv in last if uv is not None], (-1, 2))
        tracked = int(np.searchsorted(known, len(ids)))
        motion = motion_of(before[:tracked], expected.uv[known[:tracked]])
        wide = wide_ellipses(expected.s)
        asked = np.concatenate([wide, np.ones(len(waiting), dtype=np.bool_)])[known]
        uv, ok = flow_guess(self._previous, now, before[asked], self._settings.flow, motion)
        guess[known[asked]] = np.where(ok[:, None], uv, np.nan)
        return guess

    def adopt(
        self,
        view: View,
        pose: Array,
        change: MapChange,
        alive: Ids,
        recovered: Recovered | None = None,
    ) -> None:
        """Takes over what a frame did to the map, at its end.

        Parameters
        ----------
        view : View
        pose : (4, 4) float64
            T_WC at the end of the frame: new points are seen from there.
        change : MapChange
        alive : (C,) int64
            Candidates that the filter still has; all others are dropped.
        recovered : Recovered, optional
            How a camera that had lost its way was found: those landmarks were seen, and none that the search
            took for others; in another map, those features are left behind.
        """
        features, candidates = dict(self._features), dict(self._candidates)
        last, candidate_last = dict(self._last), dict(self._candidate_last)
        if recovered is not None:
            last = dict(zip(recovered.seen.ids.tolist(), recovered.seen.uv, strict=True))
            if recovered.other_map is not None:
                features, candidates, candidate_last = dict(recovered.other_map), {}, {}
        for i, patch in self._captured(view, pose, change.born):
            features[i], last[i] = patch, patch.uv_ref
        features.update(change.earlier)
        for i, patch in self._captured(view, pose, change.candidates):
            candidates[i], candidate_last[i] = patch, patch.uv_ref
        # What was a candidate keeps the patch of its first view.
        for candidate, feature in [*change.delayed.items(), *change.promoted.items()]:
            features[feature], last[feature] = candidates.pop(candidate), candidate_last.pop(candidate)
        for i in change.deleted.tolist():
            features.pop(i, None)
            last.pop(i, None)
        kept = set(alive.tolist())
        self._features, self._last = features, last
        self._candidates = {i: patch for i, patch in candidates.items() if i in kept}
        self._candidate_last = {i: uv for i, uv in candidate_last.items() if i in kept}

    def _captured(self, view: View, pose: Array, points: ImagePoints) -> Iterator[tuple[int, Patch]]:
        patches = capture(view.image, points.uv, pose)
        return zip(points.ids.tolist(), patches, strict=True)

    def adopt_map(self, ids: Ids, patches: Sequence[Patch]) -> None:
        """Takes over the landmarks of a map, none of which was seen yet, with their patches."""
        self._features = {**self._features, **dict(zip(ids.tolist(), patches, strict=True))}

    def has(self, feature: int) -> bool:
        """Whether there is such a feature."""
        return feature in self._features

    def patch(self, feature: int) -> Patch:
        """The patch of a feature."""
        return self._features[feature]

    def knows(self, features: Ids, candidates: Ids) -> bool:
        """Whether there is a patch of each of these features and candidates."""
        known = self._features.keys() >= set(features.tolist())
        return known and self._candidates.keys() >= set(candidates.tolist())

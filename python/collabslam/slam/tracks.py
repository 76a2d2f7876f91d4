"""What the front end remembers between frames: patches of features and candidates, and their last pixels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.frontend.detect import Hidden
from collabslam.frontend.flow import FlowImage, flow_guess, motion_of
from collabslam.frontend.patch import Patch, capture, warp_templates
from collabslam.frontend.search import FOUND, WIDE, SearchResult, active_search, wide_ellipses
from collabslam.settings.frontend import FrontendSettings
from collabslam.slam.state import PersistentState
from collabslam.types import Array, Ids, Image, Mask

Given = Callable[[Ids, Array, Ids], tuple[Array, Array]]
"""Expected pixels and their covariances of features, given others (ids and pixels) that were found."""

_TOLD = 16  # found features, at most, that tell the camera's motion


def chosen(expected: dict[str, Any], which: Mask) -> dict[str, Any]:
    """Some of the rows of `Filter.predict_pixels`."""
    return {name: values[which] for name, values in expected.items()}


@dataclass(frozen=True)
class Found:
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


class Tracks(PersistentState):
    """Patches and last pixels of features and candidates."""

    PERSISTENT = ("_features", "_candidates", "_last", "_candidate_last", "_previous")

    def __init__(self, camera: Camera, settings: FrontendSettings) -> None:
        self._camera = camera
        self._settings = settings
        self._features: dict[int, Patch] = {}
        self._candidates: dict[int, Patch] = {}
        self._last: dict[int, Array] = {}
        self._candidate_last: dict[int, Array] = {}
        self._previous: FlowImage | None = None

    def state(self) -> dict[str, Any]:
        """As `PersistentState.state`; of the last image, what the flow works on."""
        last = self._previous
        return {**super().state(), "_previous": None if last is None else (last.image, last.factor)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """As `PersistentState.restore`."""
        last: Any = state.get("_previous")
        if last is not None:
            last = FlowImage.again(last[0], last[1], self._settings.flow)
        super().restore({**state, "_previous": last})

    def search(
        self, image: Image, pose: Array, expected: dict[str, Any], given: Given, hidden: Hidden | None = None
    ) -> Found:
        """Active search of the expected features; candidates are followed into this frame (METHOD 7.3).

        A feature whose ellipse is wide, and of which the flow says nothing, is looked for last: where
        ``given`` (`Filter.predict_given`) expects it once others have been found.  Candidates at pixels that
        are ``hidden`` are lost.
        """
        ids: Ids = expected["ids"]
        n = len(ids)
        waiting = np.array(sorted(self._candidate_last), dtype=np.int64)
        now = FlowImage(image, self._settings.flow)
        guess = self._flow(now, ids, waiting, expected)
        patches = [self._features[i] for i in ids.tolist()] + [self._candidates[i] for i in waiting.tolist()]
        points = np.concatenate([expected["points"], np.full((len(waiting), 3), np.nan)])
        templates, usable, _ = warp_templates(self._camera, patches, pose, points, self._settings.patch)
        spread = (self._settings.flow.max_error / self._settings.search.gate) ** 2 * np.eye(2)
        result = active_search(
            image,
            templates,
            np.concatenate([expected["uv"], guess[n:]]),
            np.concatenate([expected["s"], np.broadcast_to(spread, (len(waiting), 2, 2))]),
            guess,
            self._settings,
            whole=False,
        )
        self._search_wide(image, templates, ids, result, given)
        seen = usable[:n]
        alive = (result.code[n:] == FOUND) & usable[n:]
        if hidden is not None:
            alive[alive] = ~hidden(result.uv[n:][alive])
        found = Found(
            searched=ids[seen],
            result=SearchResult(
                result.uv[:n][seen], result.score[:n][seen], result.second[:n][seen], result.code[:n][seen]
            ),
            rho=expected["rho"][seen],
            rho_sd=expected["rho_sd"][seen],
            candidates=waiting[alive],
            candidate_uv=result.uv[n:][alive],
            lost=waiting[~alive],
        )
        self._last = dict(zip(found.ids.tolist(), found.uv, strict=True))
        self._candidate_last = dict(zip(found.candidates.tolist(), found.candidate_uv, strict=True))
        self._previous = now
        return found

    def _search_wide(
        self, image: Image, templates: Image, ids: Ids, result: SearchResult, given: Given
    ) -> None:
        """Looks for the features that were left for later, and notes in ``result`` what became of them."""
        codes = result.code[: len(ids)]
        late = np.flatnonzero(codes == WIDE)
        if not len(late):
            return
        told = np.flatnonzero(codes == FOUND)
        told = told[:: max(1, -(-len(told) // _TOLD))]
        uv, s = given(ids[told], result.uv[told], ids[late])
        again = active_search(image, templates[late], uv, s, None, self._settings)
        for whole, part in zip(result, again, strict=True):
            whole[late] = part

    def _flow(self, now: FlowImage, ids: Ids, waiting: Ids, expected: dict[str, Any]) -> Array:
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
        motion = motion_of(before[:tracked], expected["uv"][known[:tracked]])
        wide = wide_ellipses(expected["s"], self._settings.search)
        asked = np.concatenate([wide, np.ones(len(waiting), dtype=np.bool_)])[known]
        uv, ok = flow_guess(self._previous, now, before[asked], self._settings.flow, motion)
        guess[known[asked]] = np.where(ok[:, None], uv, np.nan)
        return guess

    def add_features(self, image: Image, pose: Array, ids: Ids, uv: Array) -> None:
        """Starts the patches of features born in this frame."""
        patches = capture(image, uv, pose, self._settings.patch)
        for i, patch in zip(ids.tolist(), patches, strict=True):
            self._features[i] = patch
            self._last[i] = patch.uv_ref

    def add_candidates(self, image: Image, pose: Array, ids: Ids, uv: Array) -> None:
        """Starts the patches of candidates."""
        patches = capture(image, uv, pose, self._settings.patch)
        for i, patch in zip(ids.tolist(), patches, strict=True):
            self._candidates[i] = patch
            self._candidate_last[i] = patch.uv_ref

    def promote(self, candidate: int, feature: int) -> None:
        """A candidate became a feature: it keeps its patch of the first view."""
        self._features[feature] = self._candidates.pop(candidate)
        self._last[feature] = self._candidate_last.pop(candidate)

    def forget_features(self, ids: Ids) -> None:
        """Drops the patches of deleted features."""
        for i in ids.tolist():
            self._features.pop(i, None)
            self._last.pop(i, None)

    def keep_candidates(self, ids: Ids) -> None:
        """Drops every candidate that is not listed."""
        alive = set(ids.tolist())
        self._candidates = {i: p for i, p in self._candidates.items() if i in alive}
        self._candidate_last = {i: p for i, p in self._candidate_last.items() if i in alive}

    def leave_map(self) -> None:
        """Drops all features and candidates: the camera is in another map."""
        for kept in (self._features, self._candidates, self._last, self._candidate_last):
            kept.clear()

    @classmethod
    def nothing(cls) -> Found:
        """What a search finds in a map without features."""
        none, ids = np.empty(0), np.empty(0, np.int64)
        result = SearchResult(np.empty((0, 2)), none, none, np.empty(0, np.int32))
        return Found(ids, result, none, none, ids, np.empty((0, 2)), ids)

    def waiting(self, count: int) -> Ids:
        """Ids (N,) of at most so many candidates, those first that have waited longest."""
        return np.array(sorted(self._candidate_last)[: max(count, 0)], np.int64)

    def patch(self, feature: int) -> Patch:
        """The patch of a feature."""
        return self._features[feature]

    def adopt(self, ids: Ids, patches: list[Patch]) -> None:
        """Takes over patches of features that were not seen in this frame."""
        self._features.update(zip(ids.tolist(), patches, strict=True))

    def found(self, ids: Ids, uv: Array) -> None:
        """Features found in this frame in another way, in place of what the search took for them."""
        self._last = dict(zip(ids.tolist(), uv, strict=True))

    @property
    def pixels(self) -> Array:
        """(N, 2) float64: pixels of all features and candidates found in the last frame."""
        return np.reshape([*self._last.values(), *self._candidate_last.values()], (-1, 2))

    def knows(self, ids: Ids) -> bool:
        """Whether there is a patch of each of these features."""
        return all(i in self._features for i in ids.tolist())

    @property
    def candidate_count(self) -> int:
        """Number of candidates that are being followed."""
        return len(self._candidate_last)

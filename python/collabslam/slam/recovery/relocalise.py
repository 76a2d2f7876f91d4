"""Finding a lost camera again: views of the landmarks are kept, and compared when it is lost.

A map that the camera was lost in is made inactive when a new one is started, and its views are compared as
well: in frames that fail, and every now and then while the camera is in the new map.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from collabslam._core import LAST_TIME, MAX_RANGE_RATIO, Camera, Filter, UpdateReport
from collabslam.formats.schema import Check, items, number, optional, table, whole
from collabslam.frontend.describe import SUPPORT, Descriptors
from collabslam.frontend.map_views import MapViews
from collabslam.frontend.patch import Patch, capture
from collabslam.frontend.place_recognition import (
    MIN_PATCHES,
    Fix,
    ImageCorners,
    confirmed,
    describe_views,
    locate,
)
from collabslam.settings.frontend import FrontendSettings
from collabslam.slam.map_change import ImagePoints, Recovered
from collabslam.slam.recovery.inactive_map import InactiveMap, check_inactive_map
from collabslam.slam.state import PATCH, PersistentState
from collabslam.slam.targets.in_map import PrintedTargets
from collabslam.slam.tracking.tracks import Tracks
from collabslam.slam.view import View
from collabslam.types import Array, Ids

ROLLS = (0.0, 0.5, 0.0, -0.5)
"""Rolls of the camera against its views, radians: each attempt tries one of these, in turn."""
EVERY = 0.5
"""Time from one frame whose landmarks are kept as views to the next, seconds."""
VIEWS = 3
"""Views kept of a landmark beside its first, the latest ones: 2 kB of memory each."""

MAX_INACTIVE = 4
"""Inactive maps, at most; beyond it the second oldest goes, as the first is the one best tied to W."""


class Relocaliser(PersistentState):
    """Keeps views of the landmarks, and finds the camera among them.

    Parameters
    ----------
    core : Filter
    camera : Camera
        Cs.
    tracks : Tracks
        Holds the first view of every landmark.
    options : FrontendSettings
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_views": table(int, items(PATCH)),
        "_last": optional(number(-LAST_TIME, LAST_TIME)),
        "_attempts": whole(0),
        "_inactive": items(check_inactive_map),
        "_looked_back": optional(number(-LAST_TIME, LAST_TIME)),
    }

    def __init__(self, core: Filter, camera: Camera, tracks: Tracks, options: FrontendSettings) -> None:
        self._core, self._camera, self._tracks, self._options = core, camera, tracks, options
        self._views: dict[int, list[Patch]] = {}
        self._last: float | None = None
        self._attempts = 0
        self._inactive: list[InactiveMap] = []
        self._looked_back: float | None = None
        self._described: dict[int, tuple[Patch, Descriptors]] = {}

    def remember(self, view: View, pose: Array, seen: ImagePoints) -> None:
        """Keeps views of the landmarks seen in a frame from ``pose`` (T_WC), if it is time for it.

        The latest ones replace the oldest.
        """
        self._attempts = 0
        self._described.clear()
        if self._last is not None and view.t - self._last < EVERY:
            return
        self._last = view.t
        views = dict(self._views)
        patches = capture(view.image, seen.uv, pose)
        for i, patch in zip(seen.ids.tolist(), patches, strict=True):
            views[i] = [*views.get(i, []), patch][-VIEWS:]
        self._views = views

    def views(self, ids: Ids) -> list[list[Patch]]:
        """The views of each landmark, the first one first."""
        return [[self._tracks.patch(i), *self._views.get(i, [])] for i in ids.tolist()]

    def adopt(self, ids: Ids, views: list[list[Patch]]) -> None:
        """Takes over the views of a map to start in, as `views` gives them."""
        self._tracks.adopt_map(ids, [some[0] for some in views])
        later = [some[1:] for some in views]
        self._views = {**self._views, **dict(zip(ids.tolist(), later, strict=True))}

    def forget(self, ids: Ids) -> None:
        """Drops the views of deleted landmarks."""
        gone = set(ids.tolist())
        if not gone.isdisjoint(self._views):
            self._views = {i: views for i, views in self._views.items() if i not in gone}

    def map_in_use(self, printed: PrintedTargets) -> InactiveMap:
        """The map that the camera is in, with the printed targets in it, to be made inactive."""
        known, landmarks = self._core.known_map(), self._core.landmarks()
        good = landmarks.rho_ratio < MAX_RANGE_RATIO
        return InactiveMap(
            known.landmarks,
            known.covariance,
            known.place,
            np.flatnonzero(np.isin(known.ids, landmarks.ids[good])),
            landmarks.points[good],
            self.views(known.ids),
            printed.in_list(known.ids),
        )

    def make_inactive(self, old: InactiveMap | None) -> None:
        """The camera has left a map for a new one: the old one, if given, is kept if it can be recognised."""
        self._views = {}
        if old is not None and (len(old.use) >= MIN_PATCHES or old.targets):
            kept = [*self._inactive, old]
            self._inactive = kept if len(kept) <= MAX_INACTIVE else [kept[0], *kept[2:]]

    @property
    def inactive(self) -> list[InactiveMap]:
        """Inactive maps, the one that is looked for next first."""
        return self._inactive

    def attempt(self, view: View) -> Recovered | None:
        """Looks for the camera in its map, in turn with the inactive ones, and resets the filter there.

        Returns
        -------
        Recovered or None
            None if the camera was not found.
        """
        round_, turn = divmod(self._attempts, 1 + len(self._inactive))
        self._attempts += 1
        rolls = (ROLLS[round_ % len(ROLLS)],)
        return self._in_inactive(view, turn - 1, rolls) if turn else self._in_use(view, rolls)

    def look_back(self, view: View) -> Recovered | None:
        """Whether the camera sees an inactive map: asked now and then, of one map in turn.

        As `attempt`: if it does, the filter is back in that map.
        """
        if not self._inactive:
            return None
        if self._looked_back is not None and view.t - self._looked_back < EVERY:
            return None
        self._looked_back = view.t
        self._inactive = [self._inactive[-1], *self._inactive[:-1]]
        return self._in_inactive(view, 0, (0.0,))

    def seen_from_there(self, view: View, found: Recovered) -> Recovered:
        """The landmarks that an image shows from where a few points have put the camera join them.

        Where frames are so far apart that no prediction says where a landmark is, those points would else be
        all that the camera ever sees of its map.
        """
        ids, points = self._recognisable()
        others = ~np.isin(ids, found.seen.ids)
        ids, points = ids[others], points[others]
        if len(ids) < MIN_PATCHES:
            return found
        views = MapViews.of(points, self.views(ids))
        fix = confirmed(view.image, self._camera, self._core.pose, views, self._options, view.hidden)
        if fix is None:
            return found
        at = ids[fix.landmarks]
        bearings = self._core.update(at, at, fix.uv, min_inliers=MIN_PATCHES).bearings
        more = ImagePoints(at[bearings.accepted], fix.uv[bearings.accepted])
        return replace(found, seen=found.seen.with_more(more))

    def _recognisable(self) -> tuple[Ids, Array]:
        """The landmarks of the map in use whose range is known, and their points in W."""
        landmarks = self._core.landmarks()
        known = landmarks.rho_ratio < MAX_RANGE_RATIO
        return landmarks.ids[known], landmarks.points[known]

    def _in_use(self, view: View, rolls: tuple[float, ...]) -> Recovered | None:
        ids, points = self._recognisable()
        fix = self._locate(view, points, self.views(ids), rolls)
        if fix is None:
            return None
        report = self._core.relocalise(fix.pose, ids[fix.landmarks], fix.uv, predicted=self._was_predicted())
        if not report.accepted:
            return None
        return self._recovered(ids[fix.landmarks], fix, report)

    def _in_inactive(self, view: View, which: int, rolls: tuple[float, ...]) -> Recovered | None:
        old = self._inactive[which]
        fix = self._locate(view, old.points, [old.views[i] for i in old.use], rolls)
        if fix is None:
            return None
        fix = Fix(fix.pose, old.use[fix.landmarks], fix.uv)
        return self.enter(old, fix, predicted=self._was_predicted())

    def _was_predicted(self) -> bool:
        """Whether prediction says where the camera may be: of wheels, it is they who may be wrong."""
        return not self._core.followed_odometry

    def enter(
        self, old: InactiveMap, fix: Fix, least: int | None = None, *, predicted: bool = False
    ) -> Recovered | None:
        """Leaves the map in use for another one, in which an image shows the camera.

        Parameters
        ----------
        old : InactiveMap
        fix : Fix
            Landmarks by their place in that map.
        least : int, optional
            How many of them are enough, as with `Filter.relocalise`: they say themselves which they are.
        predicted : bool
            Whether prediction counts for something, as there.

        Returns
        -------
        Recovered or None
            None, and the filter stays where it was, if it does not accept the fix.
        """
        places = fix.landmarks
        there = self._core.relocalise_in(
            old.landmarks,
            old.covariance,
            old.place,
            fix.pose,
            places,
            fix.uv,
            least=least,
            predicted=predicted,
        )
        ids, report = there.ids, there.report
        if not report.accepted:
            return None
        self._inactive = [other for other in self._inactive if other is not old]
        self._views = dict(zip(ids.tolist(), [views[1:] for views in old.views], strict=True))
        first = dict(zip(ids.tolist(), [views[0] for views in old.views], strict=True))
        found = self._recovered(ids[places], fix, report, first)
        corners = {name: np.where(k >= 0, ids[k], -1) for name, k in old.targets.items()}
        return replace(found, targets=corners, identified=least is not None)

    def _locate(
        self, view: View, points: Array, by_landmark: list[list[Patch]], rolls: tuple[float, ...]
    ) -> Fix | None:
        if len(points) < MIN_PATCHES:
            return None
        views = MapViews.of(points, by_landmark)
        descriptors = self._describe(views.patches)
        corners = ImageCorners(view.image, self._options, view.hidden)
        return locate(corners, self._camera, views, descriptors, self._core.pose, rolls)

    def _recovered(
        self, ids: Ids, fix: Fix, report: UpdateReport, other_map: Mapping[int, Patch] | None = None
    ) -> Recovered:
        """What the filter accepted of a fix; candidates were seen from where the camera is not."""
        self._core.drop_candidates(self._core.candidates)
        accepted = report.bearings.accepted
        seen = ImagePoints(ids[accepted], fix.uv[accepted])
        return Recovered(seen, other_map, jumped=report.jumped)

    def _describe(self, patches: list[Patch]) -> Descriptors:
        """Descriptors of views, one after the other; made once for all attempts until the camera is found."""
        known = self._described
        new = [patch for patch in patches if id(patch) not in known]
        made = describe_views(new, SUPPORT)
        known.update({id(patch): (patch, made[k : k + 1]) for k, patch in enumerate(new)})
        return np.concatenate([known[id(patch)][1] for patch in patches])

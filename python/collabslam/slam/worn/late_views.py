"""Views of Cf that were not taken at a frame's own instant (METHOD section 21).

They wait here until a frame comes that was taken after them.  Then they are matched with the frame of Cs that
is nearest in time, of which image and points are kept as long as the filter keeps its pose.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from collabslam._core import LAST_TIME, MOST_KEPT_POSES, Camera, Filter, SearchResult
from collabslam.errors import InputError
from collabslam.formats.schema import (
    Check,
    array,
    covariance,
    flag,
    instance,
    items,
    number,
    optional,
    pose,
    refuse,
    table,
    text,
    whole,
)
from collabslam.frontend.detect import Corners, Hidden, hidden_by_any
from collabslam.frontend.patch import SIZE
from collabslam.frontend.search import FOUND
from collabslam.settings.table import Settings
from collabslam.slam.map_change import ImagePoints, MapChange
from collabslam.slam.state import PersistentState
from collabslam.slam.tracking.tracks import TrackingResult, Tracks
from collabslam.slam.view import View
from collabslam.slam.worn.matcher import WornMatcher
from collabslam.slam.worn.overlap import Overlap
from collabslam.slam.worn.wearers import Wearers
from collabslam.types import Array, Ids, Image, WornView

MOST_PENDING = 32
"""Most views that wait for their frame; of more, the oldest go."""
LATENESSES = 32
"""Views that tell how long poses are kept: until there were so many for ``worn.late``, then as long as the
latest of so many came late."""
START_GAP = 0.1
"""Largest time between a view and the frame that the filter starts from, as a share of ``worn.late``."""
STALE, FUTURE, REPEATED, SUPERSEDED, CROWDED = "stale", "future", "repeated", "superseded", "crowded"
REASONS = (STALE, FUTURE, REPEATED, SUPERSEDED, CROWDED)
"""Why a view was not used: older than what is kept, more than that ahead of its frame, used before, a newer
one came for the same frame, too many waited."""
Views = tuple[WornView, ...]
"""At most one of each worn camera."""
Step = tuple[float, Image, Views]
"""Time, image of Cs and views of the worn cameras of one frame."""


@dataclass(frozen=True)
class KeptFrame:
    """A frame of Cs that views may still come for.

    Attributes
    ----------
    t : float
        Seconds.
    image : (H, W) uint8
    ids, uv : (N,) int64, (N, 2) float64
        Features that it showed, and their pixels.
    rho, rho_sd : (N,) float64
        Their inverse ranges and standard deviations, 1/m; NaN where unknown.
    candidates, candidate_uv : (C,) int64, (C, 2) float64
        Candidates, and their pixels.
    """

    t: float
    image: Image
    ids: Ids
    uv: Array
    rho: Array
    rho_sd: Array
    candidates: Ids
    candidate_uv: Array


_TIME = number(-LAST_TIME, LAST_TIME)
_VIEW = instance(
    WornView,
    image=array("|u1", None, None),
    t_cf=pose,
    covariance=covariance(6),
    bias=optional(covariance(6)),
    t=_TIME,
    who=text(),
    body=flag,
    rate=optional(array("<f8", 3)),
)


def _frame(value: Any, where: str) -> None:
    """A `KeptFrame` whose lists agree."""
    instance(
        KeptFrame,
        t=_TIME,
        image=array("|u1", None, None),
        ids=array("<i8", None),
        uv=array("<f8", None, 2),
        rho=array("<f8", None, nan=True),
        rho_sd=array("<f8", None, nan=True),
        candidates=array("<i8", None),
        candidate_uv=array("<f8", None, 2),
    )(value, where)
    lists = {len(value.ids), len(value.uv), len(value.rho), len(value.rho_sd)}
    if len(lists) != 1 or len(value.candidates) != len(value.candidate_uv):
        refuse(where, "a frame whose lists have one length")


class LateViews(PersistentState):
    """Keeps views until they are due, and frames until no view can come for them any more.

    Parameters
    ----------
    core : Filter
    camera : Camera
        Cs.
    worn : WornMatcher
    tracks : Tracks
    settings : Settings
    wearers : Wearers
        Who is in view.
    mask : callable, optional
        Which pixels of Cs are never scene.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_pending": items(_VIEW),
        "_frames": items(_frame),
        "_async_views_seen": flag,
        "_latenesses": items(number(-LAST_TIME, LAST_TIME)),
        "dropped": table(str, whole(0)),
        "used": items(_VIEW),
    }

    def __init__(
        self,
        core: Filter,
        camera: Camera,
        worn: WornMatcher,
        tracks: Tracks,
        settings: Settings,
        wearers: Wearers,
        mask: Hidden | None = None,
    ) -> None:
        self._wearers = wearers
        self._mask = mask
        self._filter, self._camera, self._worn, self._tracks = core, camera, worn, tracks
        self._detect = settings.frontend.detect
        self._late = settings.filter.worn.late
        self._tolerance = settings.filter.worn.tolerance
        self._clock_sd = settings.filter.worn.clock_sd
        self._inbox: deque[WornView] = deque(maxlen=MOST_PENDING)
        self._pending: tuple[WornView, ...] = ()
        self._frames: tuple[KeptFrame, ...] = ()
        self._async_views_seen = False
        self._latenesses: tuple[float, ...] = ()
        self.dropped: dict[str, int] = {}
        """Views that were not used so far, by reason."""
        self.used: tuple[WornView, ...] = ()
        """Those that the last frame used, at most one of each worn camera."""

    def attributes(self) -> dict[str, Any]:
        """As `PersistentState.attributes`; what was handed in since belongs to it."""
        arrived: list[WornView] = []
        while self._inbox:
            arrived.append(self._inbox.popleft())
        if arrived:
            self._pending = (*self._pending, *arrived)
        return super().attributes()

    def state(self) -> dict[str, Any]:
        """As `PersistentState.state`."""
        kept = self.attributes()
        lists = ("_pending", "_frames", "_latenesses", "used")
        return kept | {name: list(kept[name]) for name in lists}

    def restore(self, state: Mapping[str, Any]) -> None:
        """As `PersistentState.restore`."""
        super().restore(state)
        self._pending = tuple(self._worn.require(view) for view in self._pending)
        self._latenesses, self.used = tuple(self._latenesses), tuple(self.used)
        self._frames, shape = tuple(self._frames), (self._camera.height, self._camera.width)
        if any(frame.image.shape != shape for frame in self._frames):
            refuse("kept frames", "of this camera")

    def add(self, view: WornView) -> None:
        """Hands in a view, from any thread; see `Slam.add_worn`."""
        if view.t is None:
            raise InputError(
                "a view that comes between frames needs its time; give WornView(..., t=seconds)."
            )
        self._inbox.append(self._worn.require(view))

    def frames(self, t: float, image: Image, worn: Views) -> Iterator[Step]:
        """The frame with the views that it is to use; before it, if the filter can start from one that came
        late, the frames since."""
        self.used, worn = (), self._choose(t, worn)
        start = self._start_of(t, worn)
        if start:
            self._filter.forget_time()
            yield start[0].t, start[0].image, worn[:1]
            if self._filter.started:
                yield from ((frame.t, frame.image, ()) for frame in start[1:])
            worn = worn[1:]
        yield t, image, worn

    def place(self, t: float, views: Views, *, lost: bool) -> tuple[Overlap, ...]:
        """The views that can be used, with T_CF as it is for the frame at ``t``."""
        at_frame = ((view, self._at_frame(t, view, lost=lost)) for view in views)
        found = [(view, worn) for view, worn in at_frame if worn is not None]
        self.used += tuple(view for view, _ in found)
        return tuple(Overlap(self._worn.number(view.who), view, worn, t) for view, worn in found)

    def _at_frame(self, t: float, worn: WornView, *, lost: bool) -> WornView | None:
        """The view with T_CF as it is for the frame at ``t``; None, and counted, if it is not used."""
        if worn.t is None or (worn.t == t and self._clock_sd == 0.0):
            return worn
        if worn.t == t:
            return self._carried(worn, t)
        timing = self._timing(worn)
        if lost and t - worn.t > START_GAP * self._late:
            timing = STALE  # nobody knows where Cs was
        if timing in REASONS:
            self._drop(timing)
            return None
        return self._carried(worn, t)

    def beside(
        self, view: View, overlap: Overlap, found: TrackingResult
    ) -> tuple[View, Overlap, TrackingResult]:
        """The frame nearest in time to a view of Cf, the view there, and what was found."""
        if overlap.given is overlap.worn or view.lost or not view.started:
            return view, overlap, found
        taken = overlap.taken
        nearest = min(self._frames, key=lambda frame: abs(frame.t - taken), default=None)
        if nearest is None or abs(view.t - taken) <= abs(nearest.t - taken):
            return view, overlap, found
        worn = self._carried(overlap.given, nearest.t)
        outline = self._wearers.of(worn)
        seen = {} if outline is None or not outline.is_possible else {worn.who: outline}
        hidden = hidden_by_any([self._mask, *self._wearers.hidden(seen)])
        corners = Corners(nearest.image, self._detect, SIZE, hidden=hidden)
        earlier = replace(view, t=nearest.t, image=nearest.image, corners=corners)
        ids, alive = nearest.ids, np.isin(nearest.candidates, self._filter.candidates)
        known = np.array([self._tracks.has(i) for i in ids.tolist()], np.bool_)
        some, code = np.full(int(known.sum()), 1.0), np.full(int(known.sum()), FOUND)
        return (
            earlier,
            replace(overlap, worn=worn, at=nearest.t, image=nearest.image),
            TrackingResult(
                searched=ids[known],
                result=SearchResult(nearest.uv[known], some, some, code),
                rho=nearest.rho[known],
                rho_sd=nearest.rho_sd[known],
                candidates=nearest.candidates[alive],
                candidate_uv=nearest.candidate_uv[alive],
                lost=np.empty(0, np.int64),
            ),
        )

    def keep(self, view: View, found: TrackingResult, seen: ImagePoints, change: MapChange) -> None:
        """At the end of a frame: keeps it if views come late, or may, as before the start."""
        known = len(self._latenesses) == LATENESSES
        late = max(self._latenesses) if known else self._late
        if self._async_views_seen and self._filter.started and self._filter.keep_pose(late):
            row = {i: k for k, i in enumerate(found.searched.tolist())}
            rows = np.array([row.get(i, -1) for i in seen.ids.tolist()], np.int64)
            born = change.born
            unknown = np.full(len(born), np.nan)
            depths = [np.append(x, np.nan)[rows] for x in (found.rho, found.rho_sd)]
            frame = KeptFrame(
                view.t,
                view.image.copy(),
                np.concatenate([seen.ids, born.ids]),
                np.concatenate([seen.uv, born.uv]),
                np.concatenate([depths[0], unknown]),
                np.concatenate([depths[1], unknown]),
                np.concatenate([found.candidates, change.candidates.ids]),
                np.concatenate([found.candidate_uv, change.candidates.uv]),
            )
            kept = set(self._filter.kept_times.tolist())
            self._frames = tuple(f for f in (*self._frames, frame) if f.t in kept)
        elif not self._filter.started and self._worn.is_there and self._is_time(view.t):
            none, ids, uv = np.empty(0), np.empty(0, np.int64), np.empty((0, 2))
            frame = KeptFrame(view.t, view.image.copy(), ids, uv, none, none, ids, uv)
            recent = (f for f in self._frames if view.t - f.t <= self._late)
            self._frames = (*recent, frame)[-MOST_KEPT_POSES:]

    def _is_time(self, t: float) -> bool:
        return not self._frames or t - self._frames[-1].t >= 0.75 * START_GAP * self._late

    def _carried(self, worn: WornView, frame: float) -> WornView:
        t = frame if worn.t is None else worn.t
        t_cf, spread = self._filter.carry_worn(
            worn.t_cf, worn.covariance, t, frame, who=self._worn.number(worn.who)
        )
        return replace(worn, t_cf=t_cf, covariance=spread)

    def _timing(self, view: WornView) -> str:
        return self._filter.view_timing(_time(view), who=self._worn.number(view.who))

    def _choose(self, t: float, worn: Views) -> Views:
        """The views for the frame at ``t``: of each worn camera the newest that was taken by then; later ones
        go on waiting."""
        given = (replace(view, t=t) if view.t is None else view for view in worn)
        views: list[WornView] = sorted((*self._pending, *given), key=_time)
        due = [view for view in views if _time(view) <= t + self._tolerance]
        waiting = views[len(due) :]
        ahead = [view for view in waiting if _time(view) > t + self._late]
        waiting = waiting[: len(waiting) - len(ahead)]
        self._drop(FUTURE, len(ahead))
        self._drop(CROWDED, max(0, len(waiting) - MOST_PENDING))
        self._pending = tuple(waiting[-MOST_PENDING:])
        once = {(view.who, view.t): view for view in due}
        fresh = [view for view in once.values() if self._timing(view) != REPEATED]
        self._drop(REPEATED, len(due) - len(fresh))
        newest = {view.who: view for view in fresh}
        self._drop(SUPERSEDED, len(fresh) - len(newest))
        chosen = sorted(newest.values(), key=lambda view: self._worn.number(view.who))
        for view in chosen:
            lateness = t - _time(view)
            self._latenesses = (*self._latenesses, lateness)[-LATENESSES:]
            self._async_views_seen |= abs(lateness) > self._tolerance
        return tuple(chosen)

    def _start_of(self, t: float, views: Views) -> tuple[KeptFrame, ...]:
        """Frames of before, from the one nearest to a view that came late, which a filter starts from."""
        worn = views[0] if views else None
        if worn is None or worn.t is None or self._filter.started or not self._frames:
            return ()
        gaps = [abs(frame.t - worn.t) for frame in self._frames]
        nearest = int(np.argmin(gaps))
        is_of_now = abs(t - worn.t) <= gaps[nearest]
        return () if is_of_now or gaps[nearest] > START_GAP * self._late else self._frames[nearest:]

    def _drop(self, reason: str, count: int = 1) -> None:
        if count:
            total = Counter(self.dropped)
            total[reason] += count
            self.dropped = dict(total)


def _time(view: WornView) -> float:
    assert view.t is not None
    return view.t

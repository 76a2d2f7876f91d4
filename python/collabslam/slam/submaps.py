"""Submaps of a long way, loops between them, and the camera's pose as they correct it (METHOD 24).

A submap ends where most of the landmarks that it was taken down with are out of view.  Where an earlier one
is recognised in the image, its landmarks measure the camera's pose once more: a loop.  A graph of the
submaps' poses takes the loops in.  The filter never hears of it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from collabslam._core import (
    Camera,
    Edge,
    Factor,
    Filter,
    PoseGraph,
    Sight,
    SubmapLandmarks,
    adjoint,
    chi2_quantile,
    pose_inverse,
    rotation_log,
)
from collabslam.errors import FilterError
from collabslam.formats.schema import Check, array, covariance, instance, items, number, pose, refuse, whole
from collabslam.frontend.map_views import MapViews
from collabslam.frontend.patch import Patch, capture
from collabslam.frontend.place_recognition import MIN_PATCHES, SUPPORT, describe_views, locate
from collabslam.settings.frontend import FrontendSettings
from collabslam.slam.map_change import ImagePoints
from collabslam.slam.results import Loop
from collabslam.slam.state import PATCH, SECONDS, PersistentState
from collabslam.slam.view import View
from collabslam.types import Array, Ids

LANDMARKS = 40
"""Most landmarks that are taken down of a submap: 0.2 MB with their covariance and patches."""
RECALLED = 1000
"""Latest submaps that can be recognised; of earlier ones the pose is kept, and what was measured of it."""
LEAST_FRAMES = 10
"""From the end of one submap to that of the next."""
STILL_SEEN = 0.5
"""Share of a submap's landmarks that are in view at least while it lasts."""
CANDIDATES = 2
"""Earlier submaps that the image is compared with, at most, each time that one ends."""
LEVEL = 0.9999
"""Of the chi-square test of a loop against what the graph knows."""
_MIN_VOTES = 6  # landmarks whose descriptors must look alike for a submap to be a candidate
_MAX_DISTANCE = 0.8  # of two descriptors (unit vectors) that look alike


@dataclass(frozen=True)
class Submap:
    """What is kept of a submap: its landmarks as they stood to the camera where it ended.

    Attributes
    ----------
    t : float
        When it ended, seconds.
    pose, pose_covariance : (4, 4), (6, 6) float64
        T_WC there as the filter had it, and its covariance.
    ids : (N,) int64
    points : (N, 3) float64
        Metres, in the frame of the camera.
    covariance, with_handed_on, handed_on : (3 N, 3 N), (3 N, 7), (7, 7) float64
        See `_core.Submap`.
    descriptors : (N, 128) float32
    patches : list of N Patch
        Of the image there.
    used : (N,) bool
        Landmarks that a loop rests on: each tells what it knows once.
    """

    t: float
    pose: Array
    pose_covariance: Array
    ids: Ids
    points: Array
    covariance: Array
    with_handed_on: Array
    handed_on: Array
    descriptors: NDArray[np.float32]
    patches: list[Patch]
    used: NDArray[np.bool_]

    def without_landmarks(self) -> Submap:
        """Its pose alone."""
        none = np.empty((0, 3))
        return replace(
            self,
            ids=self.ids[:0],
            points=none,
            covariance=np.empty((0, 0)),
            with_handed_on=np.empty((0, 7)),
            descriptors=self.descriptors[:0],
            patches=[],
            used=self.used[:0],
        )


@dataclass(frozen=True)
class Link:
    """A factor of the graph as it is written to a file, see `_core.Factor`."""

    first: int
    second: int
    pose: Array
    handed_on: Array
    weight: Array

    @classmethod
    def of(cls, factor: Factor) -> Link:
        """The numbers of a factor."""
        return cls(factor.first, factor.second, factor.pose, factor.handed_on, factor.weight)

    def factor(self) -> Factor:
        """The factor of these numbers."""
        return Factor(self.first, self.second, self.pose, self.handed_on, self.weight)


def _check_submap(value: Any, where: str) -> None:
    """A `Submap` whose parts fit together."""
    instance(Submap, ids=array("<i8", None))(value, where)
    n = len(value.ids)
    instance(
        Submap,
        t=number(-SECONDS, SECONDS),
        pose=pose,
        pose_covariance=covariance(6),
        points=array("<f8", n, 3),
        covariance=covariance(3 * n),
        with_handed_on=array("<f8", 3 * n, 7),
        handed_on=covariance(7),
        descriptors=array("<f4", n, 128),
        patches=items(PATCH, n),
        used=array("|b1", n),
    )(value, where)


_LINK = instance(
    Link,
    first=whole(-1),
    second=whole(0),
    pose=pose,
    handed_on=array("<f8", 7),
    weight=array("<f8", None, 20),
)
_LOOP = instance(
    Loop,
    first=whole(0),
    second=whole(0),
    t_first=number(-SECONDS, SECONDS),
    t_second=number(-SECONDS, SECONDS),
    matches=whole(0),
    residual_m=number(),
    residual_deg=number(),
    chi2=number(),
)


class Submaps(PersistentState):
    """Ends submaps, finds loops, and says where the camera is in the map that they make.

    Parameters
    ----------
    core : Filter
    camera : Camera
        Cs.
    sigma : float
        Standard deviation of a pixel of Cs.
    options : FrontendSettings
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_submaps": items(_check_submap),
        "_links": items(_LINK),
        "_loops": items(_LOOP),
        "_poses": array("<f8", None, 4, 4),
        "_handed_on": array("<f8", None, 7),
        "_frames": whole(0),
    }

    def __init__(self, core: Filter, camera: Camera, sigma: float, options: FrontendSettings) -> None:
        self._core, self._camera, self._sigma, self._options = core, camera, sigma, options
        self._submaps: list[Submap] = []
        self._links: list[Link] = []
        self._loops: list[Loop] = []
        self._poses = np.empty((0, 4, 4))
        self._handed_on = np.empty((0, 7))
        self._frames = 0
        self._made: tuple[list[Link], PoseGraph] | None = None

    @property
    def loops(self) -> list[Loop]:
        """The loops found so far."""
        return list(self._loops)

    @property
    def poses(self) -> Array:
        """(N, 4, 4) of all submaps in W, as the loops correct them."""
        return np.array(self._poses)

    @property
    def times(self) -> Array:
        """(N,) when the submaps ended, seconds."""
        return np.array([submap.t for submap in self._submaps])

    def relative(self, first: int, second: int) -> tuple[Array, Array]:
        """Pose of one submap from another, and its (6, 6) covariance (right tangent, m^2 and rad^2).

        Raises
        ------
        InputError
            If there is no such submap.
        """
        return self._graph().relative(first, second)

    def restore(self, state: Mapping[str, Any]) -> None:
        """As `PersistentState.restore`; what belongs together must fit together."""
        super().restore(state)
        count = len(self._submaps)
        links = all(max(link.first, link.second) < count for link in self._links)
        loops = all(max(loop.first, loop.second) < count for loop in self._loops)
        if len(self._poses) != count or len(self._handed_on) != count or not (links and loops):
            refuse("Submaps", "as many poses as submaps, and links between them")

    def follow(self, view: View, seen: ImagePoints) -> Loop | None:
        """After a frame with a trusted pose, in which the features ``seen`` were measured.

        Returns
        -------
        Loop or None
            The loop that was found in this frame.
        """
        self._frames += 1
        if not self._is_over(seen.ids):
            return None
        self._frames = 0
        self._end(view, seen)
        return self._close(view)

    def place(self) -> tuple[Array, Array]:
        """T_WC as the loops correct it and its (6, 6) covariance; the filter's where there are none."""
        odometry, covariance = self._core.pose, self._core.pose_covariance
        if not self._loops:
            return odometry, covariance
        last = len(self._submaps) - 1
        edge = self._core.since_submap()
        if edge is not None:
            with contextlib.suppress(FilterError):
                return self._graph().onward(last, edge)
        relative, apart = self._apart(last, odometry, covariance)
        back = adjoint(pose_inverse(relative))
        return self._poses[last] @ relative, apart + back @ self._graph().covariance(last) @ back.T

    def _is_over(self, seen: Ids) -> bool:
        if not self._submaps:
            return True
        last = self._submaps[-1].ids
        return self._frames >= LEAST_FRAMES and np.isin(last, seen).sum() <= STILL_SEEN * len(last)

    def _end(self, view: View, seen: ImagePoints) -> None:
        order = np.argsort(seen.ids)[:LANDMARKS]  # those known longest
        made = self._core.end_submap(seen.ids[order])
        uv = seen.uv[order][np.isin(seen.ids[order], made.ids)]
        patches = capture(view.image, uv, np.eye(4))
        submap = Submap(
            view.t,
            made.pose,
            made.pose_covariance,
            made.ids,
            made.points,
            made.covariance,
            made.with_handed_on,
            made.handed_on,
            describe_views(patches, SUPPORT),
            patches,
            np.zeros(len(made.ids), dtype=bool),
        )
        links = self._links_to(submap, made.edge)
        placed = submap.pose if not self._loops else self._predicted(submap, made.edge)
        kept = [*self._submaps, submap]
        if len(kept) > RECALLED:
            kept[-RECALLED - 1] = kept[-RECALLED - 1].without_landmarks()
        self._submaps, self._links = kept, [*self._links, *links]
        self._poses = np.concatenate([self._poses, placed[None]])
        self._handed_on = np.concatenate([self._handed_on, np.zeros((1, 7))])

    def _predicted(self, submap: Submap, edge: Edge | None) -> Array:
        """Where a submap ends, seen from the one before."""
        if edge is not None:
            return np.asarray(self._poses[-1] @ edge.pose)
        return np.asarray(self._poses[-1] @ pose_inverse(self._submaps[-1].pose) @ submap.pose)

    def _links_to(self, submap: Submap, edge: Edge | None) -> list[Link]:
        k = len(self._submaps)
        if k == 0:
            return [Link.of(Factor.of_pose(-1, 0, submap.pose, submap.pose_covariance))]
        if edge is not None:
            with contextlib.suppress(FilterError):  # a covariance that rounding has spoilt
                return [Link.of(Factor.between(k - 1, k, edge))]
        # Another map: what prediction knows of its place ties both, and nothing is handed on.
        relative, apart = self._apart(k - 1, submap.pose, submap.pose_covariance)
        handed_on = Factor.of_handed_on(k - 1, self._submaps[-1].handed_on)
        return [Link.of(handed_on), Link.of(Factor.of_pose(k - 1, k, relative, apart))]

    def _apart(self, submap: int, pose: Array, covariance: Array) -> tuple[Array, Array]:
        """A pose from a submap, with errors that have nothing in common: the least that is known of it."""
        known = self._submaps[submap]
        relative = pose_inverse(known.pose) @ pose
        back = adjoint(pose_inverse(relative))
        return relative, covariance + back @ known.pose_covariance @ back.T

    def _graph(self) -> PoseGraph:
        """The graph where it stands."""
        if self._made is None or self._made[0] is not self._links:
            self._made = self._links, self._graph_of(self._links)
        return self._made[1]

    def _graph_of(self, links: list[Link]) -> PoseGraph:
        last = len(self._submaps) - 1
        end = Factor.of_handed_on(last, self._submaps[last].handed_on)
        return PoseGraph(self._poses, self._handed_on, [*(link.factor() for link in links), end])

    def _adopt(self, links: list[Link], solved: PoseGraph) -> None:
        self._links, self._made = links, (links, solved)
        self._poses, self._handed_on = solved.poses, solved.handed_on

    def _close(self, view: View) -> Loop | None:
        """Looks for an earlier submap in the image in which the last one ended.

        What makes a graph that cannot be solved is not believed.
        """
        try:
            found = next(filter(None, (self._tried(view, first) for first in self._candidates())), None)
            if found is None:
                if self._loops:
                    self._adopt(self._links, self._graph().solved())
                return None
            loop, link, used = found
            links = [*self._links, link]
            solved = self._graph_of(links).solved()
        except FilterError:
            return None
        self._adopt(links, solved)
        submaps = list(self._submaps)
        submaps[loop.first] = replace(submaps[loop.first], used=submaps[loop.first].used | used)
        self._submaps, self._loops = submaps, [*self._loops, loop]
        return loop

    def _fresh(self, submap: Submap, alive: Ids) -> Ids:
        """Landmarks that would tell something new: not in the filter any more, and in no loop yet."""
        return np.flatnonzero(~submap.used & ~np.isin(submap.ids, alive))

    def _alive(self) -> Ids:
        return np.array([b.id for b in self._core.blocks if b.kind == "Feature"], dtype=np.int64)

    def _candidates(self) -> list[int]:
        """Earlier submaps whose landmarks look like those of the last one, the most alike first."""
        last, alive = self._submaps[-1], self._alive()
        votes = []
        for i, submap in enumerate(self._submaps[:-1]):
            fresh = self._fresh(submap, alive)
            if len(fresh) < MIN_PATCHES or not len(last.ids):
                continue
            alike = last.descriptors @ submap.descriptors[fresh].T
            best = alike.argmax(axis=1)
            rows = np.arange(len(best))
            mutual = alike.argmax(axis=0)[best] == rows
            near = alike[rows, best] > 1.0 - 0.5 * _MAX_DISTANCE**2
            count = int((mutual & near).sum())
            if count >= _MIN_VOTES:
                votes.append((-count, i))
        return [i for _, i in sorted(votes)[:CANDIDATES]]

    def _tried(self, view: View, first: int) -> tuple[Loop, Link, NDArray[np.bool_]] | None:
        """The loop with an earlier submap, if the image shows it where the graph allows it to be."""
        submap, second = self._submaps[first], len(self._submaps) - 1
        fresh = self._fresh(submap, self._alive())
        views = MapViews.of(submap.points[fresh], [[submap.patches[i]] for i in fresh])
        expected = pose_inverse(self._poses[first]) @ self._poses[second]
        fix = locate(
            view.image, self._camera, views, submap.descriptors[fresh], expected, (0.0,), self._options
        )
        if fix is None:
            return None
        found = self._sight(submap, fresh[fix.landmarks], fix.uv, fix.pose)
        if found is None:
            return None
        factor = Factor.of_sight(first, second, found)
        graph = self._graph().solved()
        chi2 = graph.distance(factor)
        if chi2 > chi2_quantile(LEVEL, 6.0):
            return None
        used = np.zeros(len(submap.ids), dtype=bool)
        used[fresh[fix.landmarks][found.accepted]] = True
        off = pose_inverse(pose_inverse(graph.poses[first]) @ graph.poses[second]) @ found.pose
        loop = Loop(
            first,
            second,
            submap.t,
            view.t,
            int(found.accepted.sum()),
            float(np.linalg.norm(off[:3, 3])),
            float(np.degrees(np.linalg.norm(rotation_log(off[:3, :3])))),
            chi2,
        )
        return loop, Link.of(factor), used

    def _sight(self, submap: Submap, landmarks: Ids, uv: Array, guess: Array) -> Sight | None:
        known = SubmapLandmarks(submap.points, submap.covariance, submap.with_handed_on, submap.handed_on)
        return known.sight(self._camera, self._sigma, landmarks, uv, guess, MIN_PATCHES)

"""The submaps of a way with what was measured between them, and the graph that they make (METHOD 25)."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collabslam._core import LAST_TIME, Edge, Factor, PoseGraph, adjoint, pose_inverse
from collabslam.errors import FilterError
from collabslam.formats.schema import array, fields, instance, items, number, pose, refuse, whole
from collabslam.results import Loop
from collabslam.slam.submaps.submap import Submap, check_submap
from collabslam.types import Array, Ids

RECALLED = 1000
"""Latest submaps that can be recognised; of earlier ones the pose is kept, and what was measured of it."""


@dataclass(frozen=True)
class Chain:
    """Submaps, factors between them, and where they are as the loops found so far correct them.

    Attributes
    ----------
    submaps : list of N Submap
    factors : list of Factor
    loops : list of Loop
    poses : (N, 4, 4) float64
        T_WC where they ended.
    transferred : list of N (K,) float64
        By how much what each transferred is wrong.
    """

    submaps: list[Submap]
    factors: list[Factor]
    loops: list[Loop]
    poses: Array
    transferred: list[Array]

    @classmethod
    def empty(cls) -> Chain:
        """Without a submap."""
        return cls([], [], [], np.empty((0, 4, 4)), [])

    @cached_property
    def graph(self) -> PoseGraph:
        """The graph where it stands."""
        last = len(self.submaps) - 1
        end = Factor.of_transferred(last, self.submaps[last].transferred)
        return PoseGraph(self.poses, self.transferred, [*self.factors, end])

    @cached_property
    def solved(self) -> Chain:
        """With the poses that all factors agree with best; raises FilterError where there are none."""
        graph = self.graph.solved()
        chain = replace(self, poses=graph.poses, transferred=graph.transferred)
        chain.__dict__["graph"] = graph  # with its factor, from which covariances are read
        return chain

    def longer(self, submap: Submap, edge: Edge | None, base: int | None = None) -> Chain:
        """With the next submap, and the way there from the last one if the filter knows it.

        ``base`` is the submap in whose map the filter is, where it was found in one.
        """
        if not self.submaps:
            factors, at = [Factor.of_pose(-1, 0, submap.pose, submap.pose_covariance)], submap.pose
        else:
            factors = self._ties(submap, edge, base)
            at = self.poses[-1] @ (self._way(submap.pose) if edge is None else edge.pose)
            if base is not None:
                at = self.poses[base] @ pose_inverse(self.submaps[base].pose) @ submap.pose
            if not self.loops:
                at = submap.pose
        kept = [*self.submaps, submap]
        if len(kept) > RECALLED:
            kept[-RECALLED - 1] = kept[-RECALLED - 1].without_landmarks()
        return replace(
            self,
            submaps=kept,
            factors=[*self.factors, *factors],
            poses=np.concatenate([self.poses, at[None]]),
            transferred=[*self.transferred, np.zeros(len(submap.transferred))],
        )

    def closed(self, loop: Loop, factor: Factor, used: NDArray[np.bool_]) -> Chain:
        """With one more loop, which rests on the landmarks ``used`` of its first submap."""
        submaps = list(self.submaps)
        submaps[loop.first] = replace(submaps[loop.first], used=submaps[loop.first].used | used)
        return replace(self, submaps=submaps, factors=[*self.factors, factor], loops=[*self.loops, loop])

    def within(self, base: int, pose: Array, pose_covariance: Array) -> tuple[Array, Array]:
        """A pose of the filter's seen from the submap as whose map it has the place from.

        That place's covariance is a part of the pose's, and no part of what is known of the way between both.
        """
        submap = self.submaps[base]
        relative = np.asarray(pose_inverse(submap.pose) @ pose)
        back = adjoint(pose_inverse(relative))
        values, axes = np.linalg.eigh(pose_covariance - back @ submap.pose_covariance @ back.T)
        return relative, (axes * np.maximum(values, 0.0)) @ axes.T

    def renamed(self, names: Mapping[int, int]) -> Chain:
        """With other ids of the landmarks, of those that ``names`` has."""
        submaps = []
        for submap in self.submaps:
            ids = [names.get(i, i) for i in submap.ids.tolist()]
            submaps.append(replace(submap, ids=np.array(ids, dtype=np.int64)))
        return replace(self, submaps=submaps)

    def handed_over(self, alive: Ids) -> Chain:
        """For another filter: ``alive`` are the landmarks that it is given, which are 0, 1, .. there.

        All others have ids below zero, which no filter gives.
        """
        known = np.unique(np.concatenate([np.empty(0, np.int64), *(s.ids for s in self.submaps)]))
        names = {i: -1 - k for k, i in enumerate(known.tolist())}
        return self.renamed(names | {i: k for k, i in enumerate(alive.tolist())})

    def held(self, ids: Ids) -> Chain:
        """With the landmarks of these ids used: the filter has them, and with them what they know."""
        submaps = [replace(s, used=s.used | np.isin(s.ids, ids)) for s in self.submaps]
        return replace(self, submaps=submaps)

    def apart(self, pose: Array, pose_covariance: Array) -> tuple[Array, Array]:
        """A pose of the filter's seen from the last submap, with errors that have nothing in common.

        That is the least that is known of it: its covariance is that of both poses.
        """
        relative = self._way(pose)
        back = adjoint(pose_inverse(relative))
        return relative, pose_covariance + back @ self.submaps[-1].pose_covariance @ back.T

    def _way(self, pose: Array) -> Array:
        return np.asarray(pose_inverse(self.submaps[-1].pose) @ pose)

    def _ties(self, submap: Submap, edge: Edge | None, base: int | None) -> list[Factor]:
        k = len(self.submaps)
        if edge is not None:
            with contextlib.suppress(FilterError):  # a covariance that rounding has spoilt
                return [Factor.between(k - 1, k, edge)]
        # Another map: what prediction knows of its place ties both, and nothing is transferred.
        transferred = Factor.of_transferred(k - 1, self.submaps[-1].transferred)
        pose = submap.pose, submap.pose_covariance
        if base is not None:
            return [transferred, Factor.of_pose(base, k, *self.within(base, *pose))]
        return [transferred, Factor.of_pose(k - 1, k, *self.apart(*pose))]

    def state(self) -> dict[str, Any]:
        """As `formats.container` takes it."""
        factors = [
            {name: getattr(factor, name) for name in ("first", "second", "pose", "transferred", "weight")}
            for factor in self.factors
        ]
        return {
            "submaps": self.submaps,
            "factors": factors,
            "loops": self.loops,
            "poses": self.poses,
            "transferred": self.transferred,
        }

    @classmethod
    def of(cls, state: Mapping[str, Any]) -> Chain:
        """The chain of a `state` that passed `check_chain`; raises InputError for a factor that is none."""
        factors = [Factor(**numbers) for numbers in state["factors"]]
        transferred = list(state["transferred"])
        return cls(list(state["submaps"]), factors, list(state["loops"]), state["poses"], transferred)


_LOOP = instance(
    Loop,
    first=whole(0),
    second=whole(0),
    t_first=number(-LAST_TIME, LAST_TIME),
    t_second=number(-LAST_TIME, LAST_TIME),
    matches=whole(0),
    residual_m=number(),
    residual_deg=number(),
    chi2=number(),
)
_FIELDS = fields(
    submaps=items(check_submap),
    factors=items(
        fields(
            first=whole(-1),
            second=whole(0),
            pose=pose,
            transferred=array("<f8", None),
            weight=array("<f8", None, None),
        )
    ),
    loops=items(_LOOP),
    poses=array("<f8", None, 4, 4),
    transferred=items(array("<f8", None)),
)


def _check_columns(factor: Mapping[str, Any], given: list[int], where: str) -> None:
    """A factor of as many numbers as its submaps transferred, or of none of them."""
    own = len(factor["transferred"])
    of_first = 0 if factor["first"] < 0 else given[factor["first"]]
    if own not in (0, of_first) or factor["weight"].shape[1] - 6 - own not in (0, given[factor["second"]]):
        refuse(where, "a factor of what its submaps transferred")


def check_chain(value: Any, where: str) -> None:
    """A `Chain.state` whose parts belong together."""
    _FIELDS(value, where)
    n = len(value["submaps"])
    for k, one in enumerate(value["poses"]):
        pose(one, f"{where}.poses[{k}]")
    ends = [(f["first"], f["second"]) for f in value["factors"]]
    ends += [(loop.first, loop.second) for loop in value["loops"]]
    between = all(max(pair) < n for pair in ends)
    if len(value["poses"]) != n or len(value["transferred"]) != n or not between:
        refuse(where, "as many poses as submaps, and factors and loops between them")
    given = [len(submap.transferred) for submap in value["submaps"]]
    if [len(numbers) for numbers in value["transferred"]] != given:
        refuse(where, "what each submap transferred")
    for k, factor in enumerate(value["factors"]):
        _check_columns(factor, given, f"{where}.factors[{k}]")
    if not all(submap.described for submap in value["submaps"][:-1]):
        refuse(where, "a chain whose submaps but the last can be recognised")

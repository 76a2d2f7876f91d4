"""Submaps of a long way, loops between them, and the camera's pose as they correct it (METHOD 25).

A submap ends where most of the landmarks that it was taken down with are out of view.  Where an earlier one
is recognised in the image, its landmarks measure the camera's pose once more: a loop.  A graph of the
submaps' poses takes the loops in.  The filter never hears of it.

Loops are looked for beside the frames that follow the end of a submap.  What was found counts from a certain
frame on, neither earlier nor later, however long it took: the results of a run are always the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar

import numpy as np

from collabslam._core import Camera, Edge, Filter, PosedNode, adjoint, pose_inverse
from collabslam.errors import FilterError
from collabslam.formats.schema import (
    Check,
    array,
    covariance,
    fields,
    instance,
    number,
    optional,
    pose,
    refuse,
    whole,
)
from collabslam.frontend.detect import Hidden
from collabslam.frontend.patch import capture
from collabslam.settings.frontend import FrontendSettings
from collabslam.slam.map_change import ImagePoints
from collabslam.slam.state import PersistentState
from collabslam.slam.submaps.background_task import BackgroundTask
from collabslam.slam.submaps.chain import Chain, check_chain
from collabslam.slam.submaps.loop_search import Answer, LoopSearch, Wanted
from collabslam.slam.submaps.submap import Submap
from collabslam.slam.view import View
from collabslam.types import Array, Ids

LANDMARKS = 40
"""Most landmarks that are taken down of a submap: 0.16 MB with their covariance and patches."""
LEAST_FRAMES = 10
"""From the end of one submap to what is found of it, and to the end of the next at least."""
STILL_SEEN = 0.5
"""Share of a submap's landmarks that are in view at least while it lasts."""


def _check_posed_node(value: Any, where: str) -> None:
    """The numbers of a `PosedNode`, which fit together."""
    fields(pose=pose, transferred=array("<f8", None), covariance=covariance(None))(value, where)
    covariance(6 + len(value["transferred"]))(value["covariance"], f"{where}.covariance")


class Submaps(PersistentState):
    """Ends submaps, has loops looked for, and says where the camera is in the map that they make.

    Parameters
    ----------
    core : Filter
    camera : Camera
        Cs.
    sigma : float
        Standard deviation of a pixel of Cs.
    options : FrontendSettings
    mask : callable, optional
        Which pixels of Cs are never scene.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_chain": check_chain,
        "_wanted": optional(
            instance(Wanted, image=array("|u1", None, None), alive=array("<i8", None), map_drift=number(0.0))
        ),
        "_posed_node": optional(_check_posed_node),
        "_frames": whole(0),
        "_base": optional(whole(0)),
    }

    def __init__(
        self,
        core: Filter,
        camera: Camera,
        sigma: float,
        options: FrontendSettings,
        mask: Hidden | None = None,
    ) -> None:
        self._core, self._camera = core, camera
        self._search = LoopSearch(camera, sigma, options, mask)
        self._background: BackgroundTask[Answer] = BackgroundTask()
        self._chain = Chain.empty()
        self._wanted: Wanted | None = None
        self._posed_node: PosedNode | None = None
        self._frames = 0
        self._base: int | None = None

    def state(self) -> dict[str, Any]:
        """As `PersistentState.state`."""
        at = self._posed_node
        posed_node = at and {"pose": at.pose, "transferred": at.transferred, "covariance": at.covariance}
        return {**self.attributes(), "_chain": self._chain.state(), "_posed_node": posed_node}

    def restore(self, state: Mapping[str, Any]) -> None:
        """As `PersistentState.restore`; what belongs together must fit together."""
        super().restore(state)
        self._chain = Chain.of(state["_chain"])
        self._posed_node = None if state["_posed_node"] is None else PosedNode(**state["_posed_node"])
        if self._wanted is None and not all(submap.described for submap in self._chain.submaps):
            refuse("Submaps", "a chain whose submaps can be recognised")
        if self._base is not None and self._base >= len(self._chain.submaps):
            refuse("Submaps", "a submap to be in")
        if self._wanted is not None and not self._chain.submaps:
            refuse("Submaps", "a search for the last submap")
        way = self._core.since_submap()
        if way is not None:
            ends = [submap.transferred for submap in self._chain.submaps[-1:]]
            ends += [self._posed_node.transferred] if self._posed_node is not None else []
            if any(len(end) != len(way.revised) for end in ends):
                refuse("Submaps", "of as many worn cameras as the filter")
        size = self._camera.height, self._camera.width
        if self._wanted is not None and self._wanted.image.shape != size:
            refuse("Submaps", f"an image of {size[1]}x{size[0]} pixels")

    def chain(self) -> Chain:
        """Submaps and loops with what is found of the last one, for which this waits."""
        return self._chain if self._wanted is None else self._answer(self._wanted).chain

    def begin(self, chain: Chain) -> None:
        """Goes on from the submaps of an earlier run, in its W."""
        self._chain = chain
        if chain.loops:
            self._posed_node = chain.graph.posed_node(len(chain.submaps) - 1)

    def found_in(self, base: int, ids: list[int]) -> None:
        """The filter has the landmarks of a submap as its map, with these ids in their order."""
        if self._wanted is not None:
            self._adopt(self._answer(self._wanted))
        names = dict(zip(self._chain.submaps[base].ids.tolist(), ids, strict=True))
        self._chain = self._chain.renamed(names).held(np.array(ids, dtype=np.int64))
        self._base = base
        if self._posed_node is not None:
            self._posed_node = self._chain.graph.posed_node(base)

    def elsewhere(self) -> None:
        """The filter is in a map that is not a submap's."""
        if self._base is not None and self._posed_node is not None:
            self._posed_node = self._chain.graph.posed_node(len(self._chain.submaps) - 1)
        self._base = None

    def follow(self, view: View, seen: ImagePoints) -> int:
        """After a frame with a trusted pose, in which the features ``seen`` were measured.

        Returns
        -------
        int
            How many loops count from this frame on.
        """
        self._frames += 1
        if self._frames < LEAST_FRAMES and self._chain.submaps:
            return 0
        before = len(self._chain.loops)
        if self._wanted is not None:
            self._adopt(self._answer(self._wanted))
        if self._is_over(seen.ids):
            self._end(view, seen)
        return len(self._chain.loops) - before

    def place(self) -> tuple[Array, Array]:
        """T_WC as the loops correct it and its (6, 6) covariance; the filter's where there are none."""
        odometry, covariance = self._core.pose, self._core.pose_covariance
        if self._posed_node is None:
            return odometry, covariance
        nothing = np.empty((0, 0))
        now = self._onward(self._posed_node, self._core.since_submap(), odometry, covariance, nothing)
        return now.pose, now.covariance[:6, :6]

    def _is_over(self, seen: Ids) -> bool:
        if not self._chain.submaps:
            return True
        last = self._chain.submaps[-1].ids
        return bool(np.isin(last, seen).sum() <= STILL_SEEN * len(last))

    def _end(self, view: View, seen: ImagePoints) -> None:
        order = np.argsort(seen.ids)[:LANDMARKS]  # those known longest
        made = self._core.end_submap(seen.ids[order])
        patches = capture(view.image, seen.uv[order][np.isin(seen.ids[order], made.ids)], np.eye(4))
        submap = Submap.taken_down(view.t, made, patches)
        if self._posed_node is not None:
            as_filter_has_it = made.pose, made.pose_covariance, made.transferred
            self._posed_node = self._onward(self._posed_node, made.edge, *as_filter_has_it)
        self._chain = self._chain.longer(submap, made.edge, self._base)
        self._base = None
        self._frames = 0
        self._wanted = Wanted(view.image.copy(), self._core.features, made.map_drift)
        self._background.begin(self._wanted, self._work(self._wanted))

    def _onward(
        self,
        posed_node: PosedNode,
        edge: Edge | None,
        pose: Array,
        pose_covariance: Array,
        transferred: Array,
    ) -> PosedNode:
        """Where the filter's pose is, seen from a submap whose pose is known, the last one that ended.

        Where the filter has begun another map since, only what is known of both poses ties them.
        """
        if edge is not None:
            try:
                return posed_node.onward(edge)
            except FilterError:  # a covariance that rounding has spoilt
                pass
        if self._base is None:
            relative, apart = self._chain.apart(pose, pose_covariance)
        else:
            relative, apart = self._chain.within(self._base, pose, pose_covariance)
        back = adjoint(pose_inverse(relative))
        n = len(transferred)
        joint = np.zeros((6 + n, 6 + n))
        joint[:6, :6] = apart + back @ posed_node.covariance[:6, :6] @ back.T
        joint[6:, 6:] = transferred
        return PosedNode(posed_node.pose @ relative, np.zeros(n), joint)

    def _answer(self, wanted: Wanted) -> Answer:
        return self._background.result(wanted, self._work(wanted))

    def _work(self, wanted: Wanted) -> partial[Answer]:
        return partial(self._search.look, self._chain, wanted)

    def _adopt(self, answer: Answer) -> None:
        self._chain, self._wanted = answer.chain, None
        if answer.posed_node is not None:
            self._posed_node = answer.posed_node

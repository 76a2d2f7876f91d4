"""A loop looked for: an earlier submap in the image in which the last one ended (METHOD 25).

All of it is a function of what it is given, so that it can run beside the frames that follow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from collabslam._core import (
    SURE_LEVEL,
    Camera,
    Factor,
    PosedNode,
    SubmapLandmarks,
    chi2_quantile,
    pose_inverse,
    rotation_log,
)
from collabslam.errors import FilterError
from collabslam.frontend.describe import SUPPORT
from collabslam.frontend.detect import Hidden
from collabslam.frontend.map_views import MapViews
from collabslam.frontend.place_recognition import (
    MIN_PATCHES,
    MIN_VOTES,
    Fix,
    ImageCorners,
    describe_views,
    locate,
    votes,
)
from collabslam.results import Loop
from collabslam.settings.frontend import FrontendSettings
from collabslam.slam.submaps.chain import Chain
from collabslam.slam.submaps.submap import Submap, in_bytes
from collabslam.types import Ids, Image

CANDIDATES = 2
"""Earlier submaps that the image is compared with, at most, each time that one ends."""


@dataclass(frozen=True)
class Wanted:
    """What a search needs besides the chain.

    Attributes
    ----------
    image : (H, W) uint8
        In which the last submap ended.
    alive : (N,) int64
        Landmarks that the filter held then: a loop with these would tell what it knows already.
    map_drift : float
        Standard deviation of what the matches of a loop share, radians (METHOD 20).
    """

    image: Image
    alive: Ids
    map_drift: float


@dataclass(frozen=True)
class Answer:
    """The chain with its last submap described and with the loop, if one was found.

    Attributes
    ----------
    chain : Chain
    posed_node : PosedNode or None
        The last submap as the loops correct it; None without any loop.
    """

    chain: Chain
    posed_node: PosedNode | None


class LoopSearch:
    """Looks for loops.

    Parameters
    ----------
    camera : Camera
        Cs.
    sigma : float
        Standard deviation of a pixel of Cs.
    options : FrontendSettings
    mask : callable, optional
        Which pixels of Cs are never scene.
    """

    def __init__(
        self, camera: Camera, sigma: float, options: FrontendSettings, mask: Hidden | None = None
    ) -> None:
        self._camera, self._sigma, self._options = camera, sigma, options
        self._mask = mask

    def look(self, chain: Chain, wanted: Wanted) -> Answer:
        """Looks for an earlier submap in the image, and solves the graph.

        What makes a graph that cannot be solved is not believed.
        """
        chain = _described(chain)
        try:
            found = self._closed(chain, wanted)
            solved = found or (chain.solved if chain.loops else None)
            if solved is not None:
                posed_node = solved.graph.posed_node(len(solved.submaps) - 1)
                return Answer(replace(solved), posed_node)  # without its factor, as a file holds it
        except FilterError:
            pass
        return Answer(chain, None)

    def _closed(self, chain: Chain, wanted: Wanted) -> Chain | None:
        """The chain with the first loop that is believed."""
        corners = ImageCorners(wanted.image, self._options, self._mask)
        for first in _candidates(chain, wanted.alive):
            closed = self._tried(chain, wanted, corners, first)
            if closed is not None:
                return closed
        return None

    def _tried(self, chain: Chain, wanted: Wanted, corners: ImageCorners, first: int) -> Chain | None:
        """The chain closed with a submap, if the image shows it where the graph allows it to be."""
        submap, second = chain.submaps[first], len(chain.submaps) - 1
        fresh = _fresh(submap, wanted.alive)
        fix = self._located(chain, corners, first, fresh)
        if fix is None:
            return None
        known = SubmapLandmarks(submap.points, submap.covariance, submap.with_transferred, submap.transferred)
        landmarks = fresh[fix.landmarks]
        noise = self._sigma, wanted.map_drift
        found = known.pnp(self._camera, *noise, landmarks, fix.uv, fix.pose, MIN_PATCHES)
        if found is None:
            return None
        factor = Factor.of_submap_pnp(first, second, found)
        before = chain.solved
        chi2 = before.graph.distance(factor)
        if chi2 > chi2_quantile(SURE_LEVEL, 6.0):
            return None
        off = pose_inverse(pose_inverse(before.poses[first]) @ before.poses[second]) @ found.pose
        loop = Loop(
            first,
            second,
            submap.t,
            chain.submaps[second].t,
            int(found.accepted.sum()),
            float(np.linalg.norm(off[:3, 3])),
            float(np.degrees(np.linalg.norm(rotation_log(off[:3, :3])))),
            chi2,
        )
        used: NDArray[np.bool_] = np.zeros(len(submap.ids), dtype=bool)
        used[landmarks[found.accepted]] = True
        return before.closed(loop, factor, used).solved

    def _located(self, chain: Chain, corners: ImageCorners, first: int, fresh: Ids) -> Fix | None:
        """Where in the submap the camera is, by the patches of its landmarks."""
        submap = chain.submaps[first]
        patches = submap.patches
        views = MapViews.of(submap.points[fresh], [[patches[i]] for i in fresh])
        expected = pose_inverse(chain.poses[first]) @ chain.poses[-1]
        descriptors = submap.descriptors[fresh]
        return locate(corners, self._camera, views, descriptors, expected, (0.0,))


def _described(chain: Chain) -> Chain:
    """With descriptors of the last submap."""
    last = chain.submaps[-1]
    last = replace(last, codes=in_bytes(describe_views(last.patches, SUPPORT)))
    return replace(chain, submaps=[*chain.submaps[:-1], last])


def _fresh(submap: Submap, alive: Ids) -> Ids:
    """Landmarks that would tell something new: not in the filter any more, and in no loop yet."""
    return np.flatnonzero(~submap.used & ~np.isin(submap.ids, alive))


def _candidates(chain: Chain, alive: Ids) -> list[int]:
    """Earlier submaps whose landmarks look like those of the last one, the most alike first."""
    last, counts = chain.submaps[-1], []
    for i, submap in enumerate(chain.submaps[:-1]):
        fresh = _fresh(submap, alive)
        if len(fresh) < MIN_PATCHES or not len(last.ids):
            continue
        count = votes(last.descriptors @ submap.descriptors[fresh].T)
        if count >= MIN_VOTES:
            counts.append((-count, i))
    return [i for _, i in sorted(counts)[:CANDIDATES]]

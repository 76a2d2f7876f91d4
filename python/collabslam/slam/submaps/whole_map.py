"""A whole way as its loops correct it: where its submaps are, and all their landmarks (METHOD 25)."""

from __future__ import annotations

import numpy as np

from collabslam._core import PosedNode, skew
from collabslam.errors import FilterError
from collabslam.results import Landmarks, SubmapPoses
from collabslam.slam.submaps.chain import Chain
from collabslam.slam.submaps.submap import Submap
from collabslam.types import Array

_SPOILT = "What a submap transferred has a singular covariance; start a new map."
_LEAST_VARIANCE = 1e-12  # of what is transferred; below it, it is taken to be known


def submap_poses(chain: Chain) -> SubmapPoses:
    """The submaps of a chain, and the landmarks of those that can be recognised, in W.

    Raises
    ------
    FilterError
        If a covariance is spoilt, by rounding or in a file.
    """
    posed_nodes = [chain.graph.posed_node(k) for k in range(len(chain.submaps))]
    return SubmapPoses(
        times=np.array([submap.t for submap in chain.submaps]),
        poses=np.array(chain.poses),
        covariances=np.array([at.covariance[:6, :6] for at in posed_nodes]).reshape(-1, 6, 6),
        odometry=np.array([submap.pose for submap in chain.submaps]).reshape(-1, 4, 4),
        loops=list(chain.loops),
        landmarks=_landmarks(chain.submaps, posed_nodes),
    )


def _landmarks(submaps: list[Submap], posed_nodes: list[PosedNode]) -> Landmarks:
    found: dict[int, tuple[Array, Array]] = {}
    for submap, at in zip(submaps, posed_nodes, strict=True):
        if len(submap.ids):
            found.update(zip(submap.ids.tolist(), zip(*_in_w(submap, at), strict=True), strict=True))
    ids = np.array(sorted(found), dtype=np.int64)
    points = np.array([found[i][0] for i in ids.tolist()]).reshape(-1, 3)
    return Landmarks(ids, points, np.array([found[i][1] for i in ids.tolist()]).reshape(-1, 3, 3))


def _in_w(submap: Submap, at: PosedNode) -> tuple[Array, Array]:
    """Points (N, 3) and covariances (N, 3, 3) of a submap's landmarks in W.

    What the graph knows of the errors that were transferred where the submap ended corrects the points, too.
    """
    n, rotation = len(submap.ids), at.pose[:3, :3]
    k = len(submap.transferred)
    transferred = submap.transferred + _LEAST_VARIANCE * np.eye(k)
    try:
        gains = np.linalg.solve(transferred, submap.with_transferred.T).T
    except np.linalg.LinAlgError as error:
        raise FilterError(_SPOILT) from error
    points = submap.points + (gains @ at.transferred).reshape(n, 3)
    gains, with_transferred = gains.reshape(n, 3, k), submap.with_transferred.reshape(n, 3, k)
    blocks = submap.covariance.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n)]
    own = blocks - gains @ with_transferred.transpose(0, 2, 1)
    turned = np.stack([-skew(point) for point in points])
    by = rotation @ np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), turned, gains], axis=2)
    covariance = by @ at.covariance @ by.transpose(0, 2, 1) + rotation @ own @ rotation.T
    return points @ rotation.T + at.pose[:3, 3], 0.5 * (covariance + covariance.transpose(0, 2, 1))

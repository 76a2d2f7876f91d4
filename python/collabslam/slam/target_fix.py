"""A lost camera found by printed targets that its map holds: corners that say which they are (METHOD 17).

A target seen nearly from the front has two tilts that explain its corners about equally well, and the camera
is metres apart in them.  What the other targets in the image say, or else where prediction puts the camera,
has to choose between the two; where neither does, the target waits for a better view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from collabslam._core import Camera, Filter
from collabslam.geometry import nearest_rotation, pose, pose_inverse, se3_log
from collabslam.slam.map_change import ImagePoints, Recovered
from collabslam.targets.printed import AMBIGUOUS, planar_solutions
from collabslam.types import Array, Board, Ids, Tag

FEWEST = 4
"""Corners of a target in the map that it takes to tell the pose."""
_BELIEVABLE = 22.5
"""Chi square of six numbers (99.9 %): a prediction further off than that was wrong, and chooses nothing."""


@dataclass(frozen=True)
class SeenTarget:
    """A printed target in an image, and the features of the map that its corners are.

    Attributes
    ----------
    target : Tag or Board
    uv : (N, 2) float64
        Pixels of its corners.
    ids : (N,) int64
        Their features; some may be gone.
    """

    target: Tag | Board
    uv: Array
    ids: Ids


def find_by_targets(core: Filter, camera: Camera, seen: Sequence[SeenTarget]) -> Recovered | None:
    """Resets the filter to where the targets in the image put the camera; None if they do not tell.

    Parameters
    ----------
    core : Filter
        Started; it stays as it was where nothing is found.
    camera : Camera
        Cs.
    seen : sequence of SeenTarget
    """
    landmarks = core.landmarks()
    row = {i: k for k, i in enumerate(landmarks.ids.tolist())}
    held = [(s, np.array([k for k, i in enumerate(s.ids.tolist()) if i in row], np.int64)) for s in seen]
    held = [(s, at) for s, at in held if len(at) >= FEWEST]
    if not held:
        return None
    ids = np.concatenate([s.ids[at] for s, at in held])
    uv = np.concatenate([s.uv[at] for s, at in held])
    corners = _Corners(core, ids, uv, max(FEWEST, len(ids) // 2 + 1))
    for s, at in held:
        points = landmarks.points[[row[i] for i in s.ids[at].tolist()]]
        t_wt = _rigid(s.target.corners()[at], points)
        poses = [(chi2, t_wt @ t_tc) for chi2, t_tc, _ in planar_solutions(s.target, s.uv, camera)]
        first = corners.choose(poses)
        if first is None:
            continue
        report = core.relocalise(first, ids, uv, least=corners.least)
        if report.accepted:
            core.drop_candidates(core.candidates)
            accepted = report.bearings.accepted
            return Recovered(ImagePoints(ids[accepted], uv[accepted]), identified=True)
    return None


@dataclass(frozen=True)
class _Corners:
    """All corners in the image, and how many of them a pose has to explain: more than half."""

    core: Filter
    ids: Ids
    uv: Array
    least: int

    def choose(self, poses: Sequence[tuple[float, Array]]) -> Array | None:
        """Of a target's poses T_WC, each with its chi square, the right one; None if that is open."""
        if len(poses) < 2:
            return poses[0][1] if poses else None
        possible = []
        for chi2, first in poses:
            surprise = self._surprise(first)
            if surprise is not None:
                possible.append((chi2, surprise, first))
        if not possible:
            return None
        # A prediction that none of them agrees with was wrong.
        believed = min(surprise for _, surprise, _ in possible) < _BELIEVABLE
        cost = [chi2 + (surprise if believed else 0.0) for chi2, surprise, _ in possible]
        best, *others = np.argsort(cost).tolist()
        return None if any(cost[k] - cost[best] < AMBIGUOUS for k in others) else possible[best][2]

    def _surprise(self, first: Array) -> float | None:
        """Squared distance, in standard deviations, from the prediction; None if the corners contradict."""
        trial = Filter.restore(self.core.snapshot())
        if not trial.relocalise(first, self.ids, self.uv, least=self.least).accepted:
            return None
        off = se3_log(pose_inverse(self.core.pose) @ trial.pose)
        return float(off @ np.linalg.solve(self.core.pose_covariance + trial.pose_covariance, off))


def _rigid(points: Array, moved: Array) -> Array:
    """The motion (4, 4) that takes points (N, 3) best to others (Kabsch)."""
    a, b = points.mean(axis=0), moved.mean(axis=0)
    turn = nearest_rotation((moved - b).T @ (points - a))
    return pose(turn, b - turn @ a)

"""Where printed targets of a map put the camera: by corners that say which they are (METHOD 17).

A target seen nearly from the front has two tilts that explain its corners about equally well, and the camera
is metres apart in them.  What the other targets in the image say, or else where prediction puts the camera,
has to choose between the two; where neither does, the target waits for a better view.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from collabslam._core import FEWEST_MATCHES, Camera, Filter
from collabslam.frontend.place_recognition import Fix
from collabslam.geometry import nearest_rotation, pose, pose_inverse, se3_log
from collabslam.slam.targets.in_map import SeenTarget
from collabslam.targets.printed import AMBIGUOUS, planar_solutions
from collabslam.types import Array, Ids

BELIEVABLE = 22.5
"""Chi square of six numbers (99.9 %): a prediction further off than that was wrong, and chooses nothing."""

Put = Callable[[Array, Ids, Array, int], Filter | None]
"""Puts a filter like the one in use where corners (ids and pixels) have it, from a first pose and with how
many of them at least; None if they contradict."""


def surprise(core: Filter, trial: Filter) -> float:
    """Squared distance of a pose from the prediction, in standard deviations."""
    off = se3_log(pose_inverse(core.pose) @ trial.pose)
    return float(off @ np.linalg.solve(core.pose_covariance + trial.pose_covariance, off))


def fixes(
    core: Filter, camera: Camera, seen: Sequence[SeenTarget], known: tuple[Ids, Array], put: Put
) -> Iterator[tuple[Fix, int]]:
    """Where each target puts the camera, with all corners that there are, and how many have to agree.

    ``known`` are landmarks and where they are in W, metres.
    """
    ids, places = known
    row = {i: k for k, i in enumerate(ids.tolist())}
    held = [(s, np.array([k for k, i in enumerate(s.ids.tolist()) if i in row], np.int64)) for s in seen]
    held = [(s, at) for s, at in held if len(at) >= FEWEST_MATCHES]
    if not held:
        return
    all_ids = np.concatenate([s.ids[at] for s, at in held])
    uv = np.concatenate([s.uv[at] for s, at in held])
    least = max(FEWEST_MATCHES, len(all_ids) // 2 + 1)
    for s, at in held:
        points = places[[row[i] for i in s.ids[at].tolist()]]
        t_wt = _rigid(s.target.corners()[at], points)
        poses = [(chi2, t_wt @ t_tc) for chi2, t_tc, _ in planar_solutions(s.target, s.uv, camera)]
        first = _choose(core, poses, lambda pose: put(pose, all_ids, uv, least))
        if first is not None:
            yield Fix(first, all_ids, uv), least


def _choose(
    core: Filter, poses: Sequence[tuple[float, Array]], put: Callable[[Array], Filter | None]
) -> Array | None:
    """Of a target's poses T_WC, each with its chi square, the right one; None if that is open."""
    if len(poses) < 2:
        return poses[0][1] if poses else None
    possible = []
    for chi2, first in poses:
        trial = put(first)
        if trial is not None:
            possible.append((chi2, surprise(core, trial), first))
    if not possible:
        return None
    # A prediction that none of them agrees with was wrong.
    believed = min(surprise for _, surprise, _ in possible) < BELIEVABLE
    cost = [chi2 + (surprise if believed else 0.0) for chi2, surprise, _ in possible]
    best, *others = np.argsort(cost).tolist()
    return None if any(cost[k] - cost[best] < AMBIGUOUS for k in others) else possible[best][2]


def _rigid(points: Array, moved: Array) -> Array:
    """The motion (4, 4) that takes points (N, 3) best to others (Kabsch)."""
    a, b = points.mean(axis=0), moved.mean(axis=0)
    turn = nearest_rotation((moved - b).T @ (points - a))
    return pose(turn, b - turn @ a)

"""A camera found by printed targets of its map or one put aside: corners that say which they are (METHOD 17).

A target seen nearly from the front has two tilts that explain its corners about equally well, and the camera
is metres apart in them.  What the other targets in the image say, or else where prediction puts the camera,
has to choose between the two; where neither does, the target waits for a better view.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from collabslam._core import Camera, Filter
from collabslam.frontend.place_recognition import Fix
from collabslam.geometry import nearest_rotation, pose, pose_inverse, se3_log
from collabslam.slam.map_change import ImagePoints, Recovered
from collabslam.slam.recovery.map_aside import MapAside
from collabslam.slam.recovery.relocalise import Relocaliser
from collabslam.slam.targets.in_map import SeenTarget
from collabslam.targets.printed import AMBIGUOUS, planar_solutions
from collabslam.types import Array, Ids

FEWEST = 4
"""Corners of a target in the map that it takes to tell the pose."""
_BELIEVABLE = 22.5
"""Chi square of six numbers (99.9 %): a prediction further off than that was wrong, and chooses nothing."""

_Put = Callable[[Array, Ids, Array, int], Filter | None]


def find_by_targets(core: Filter, camera: Camera, seen: Sequence[SeenTarget]) -> Recovered | None:
    """Resets the filter to where the targets in the image put the camera; None if they do not tell.

    Parameters
    ----------
    core : Filter
        Started; it stays as it was where nothing is found.
    camera : Camera
        Cs.
    seen : sequence of SeenTarget
        With features of the map in use.
    """
    landmarks = core.landmarks()
    put = partial(_put, core)
    for fix, least in _fixes(core, camera, seen, (landmarks.ids, landmarks.points), put):
        report = core.relocalise(fix.pose, fix.landmarks, fix.uv, least=least)
        if report.accepted:
            core.drop_candidates(core.candidates)
            accepted = report.bearings.accepted
            points = ImagePoints(fix.landmarks[accepted], fix.uv[accepted])
            return Recovered(points, identified=True, jumped=report.jumped)
    return None


def find_in_aside(
    core: Filter, camera: Camera, seen: Sequence[SeenTarget], maps: Relocaliser, old: MapAside, *, lost: bool
) -> Recovered | None:
    """Leaves the map in use for one put aside, if the targets in the image put the camera there.

    Parameters
    ----------
    core : Filter
        Started; it stays as it was where nothing is found.
    camera : Camera
        Cs.
    seen : sequence of SeenTarget
        With landmarks by their places in that map.
    maps : Relocaliser
    old : MapAside
        One of those that ``maps`` holds.
    lost : bool
        Whether the camera may be anywhere.  Else a target that puts it where it cannot be was moved.
    """
    put = partial(_put_in, core, old)
    for fix, least in _fixes(core, camera, seen, (old.use, old.points), put):
        trial = put(fix.pose, fix.landmarks, fix.uv, least)
        if trial is not None and (lost or _surprise(core, trial) < _BELIEVABLE):
            return maps.enter(old, fix, least)
    return None


def _put(core: Filter, first: Array, ids: Ids, uv: Array, least: int) -> Filter | None:
    """A filter like this one where corners put it; None if they contradict."""
    trial = Filter.restore(core.snapshot())
    return trial if trial.relocalise(first, ids, uv, least=least).accepted else None


def _put_in(core: Filter, old: MapAside, first: Array, ids: Ids, uv: Array, least: int) -> Filter | None:
    """The same in another map, whose landmarks ``ids`` are, by their places."""
    trial = Filter.restore(core.snapshot())
    there = trial.relocalise_in(old.landmarks, old.covariance, old.place, first, ids, uv, least=least)
    return trial if there.report.accepted else None


def _surprise(core: Filter, trial: Filter) -> float:
    """Squared distance of a pose from the prediction, in standard deviations."""
    off = se3_log(pose_inverse(core.pose) @ trial.pose)
    return float(off @ np.linalg.solve(core.pose_covariance + trial.pose_covariance, off))


def _fixes(
    core: Filter, camera: Camera, seen: Sequence[SeenTarget], known: tuple[Ids, Array], put: _Put
) -> Iterator[tuple[Fix, int]]:
    """Where each target puts the camera, with all corners that there are, and how many have to agree.

    ``known`` are landmarks and where they are in W, metres.
    """
    ids, places = known
    row = {i: k for k, i in enumerate(ids.tolist())}
    held = [(s, np.array([k for k, i in enumerate(s.ids.tolist()) if i in row], np.int64)) for s in seen]
    held = [(s, at) for s, at in held if len(at) >= FEWEST]
    if not held:
        return
    all_ids = np.concatenate([s.ids[at] for s, at in held])
    uv = np.concatenate([s.uv[at] for s, at in held])
    least = max(FEWEST, len(all_ids) // 2 + 1)
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
            possible.append((chi2, _surprise(core, trial), first))
    if not possible:
        return None
    # A prediction that none of them agrees with was wrong.
    believed = min(surprise for _, surprise, _ in possible) < _BELIEVABLE
    cost = [chi2 + (surprise if believed else 0.0) for chi2, surprise, _ in possible]
    best, *others = np.argsort(cost).tolist()
    return None if any(cost[k] - cost[best] < AMBIGUOUS for k in others) else possible[best][2]


def _rigid(points: Array, moved: Array) -> Array:
    """The motion (4, 4) that takes points (N, 3) best to others (Kabsch)."""
    a, b = points.mean(axis=0), moved.mean(axis=0)
    turn = nearest_rotation((moved - b).T @ (points - a))
    return pose(turn, b - turn @ a)

"""Are depths that come with the frames in the unit of the true poses?

Two frames whose poses are known place their matches in space; a depth beside a match tells the same.
"""

from __future__ import annotations

import numpy as np

from collabslam.checks.lengths import NEAR
from collabslam.checks.matching import LEAST_MATCHES, describe, in_front, match_points
from collabslam.checks.robot import LEAST_BASELINE, RobotReport
from collabslam.checks.samples import spread
from collabslam.frontend.epipolar import inverse_ranges
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Recording

FRAMES = 12
_GAPS = (20, 10, 5, 3, 2)
_REACH = 4.0
"""Pixels from a match to a depth that is taken for its own."""


def check_depth(recording: Recording, robot: RobotReport) -> list[str]:
    """What is wrong with the unit of the depths, in a sentence; nothing where nothing tells it."""
    if not getattr(recording, "has_depth", False) or robot.poses is None or not robot.by_gap:
        return []
    ratios = [_ratios(recording, robot, i) for i in spread(range(len(recording)), FRAMES)]
    every = np.concatenate(ratios)
    if len(every) < LEAST_MATCHES:
        return []
    ratio = float(np.median(every))
    if abs(np.log(ratio)) < np.log(NEAR):
        return []
    return [
        f"The depths of the frames are {ratio:.3g} times as long as the true poses tell: if those are in "
        f"metres, --depth-scale is to be {ratio:.3g} times what was taken."
    ]


def _ratios(recording: Recording, robot: RobotReport, i: int) -> Array:
    """Depth over what two poses tell, for the matches of frame ``i`` beside which there is one."""
    poses, model, frame = robot.poses, robot.model, recording.frame(i)
    assert poses is not None
    for j in (i + way * gap for gap in _GAPS for way in (1, -1)):
        if frame.depth is None or not 0 <= j < len(recording) or not np.isfinite(poses[[i, j]]).all():
            continue
        t = pose_inverse(poses[i]) @ poses[j]
        if np.linalg.norm(t[:3, 3]) < LEAST_BASELINE:
            continue
        matches = match_points(describe(frame.image), describe(recording.image(j)))
        ahead = in_front(matches, model, model, t) == 1.0
        if ahead.sum() < LEAST_MATCHES or not len(frame.depth.depth):
            continue
        rays = model.rays(matches.uv_a[ahead]), model.rays(matches.uv_b[ahead])
        a, b = (r / np.linalg.norm(r, axis=1, keepdims=True) for r in rays)
        told = a[:, 2] / inverse_ranges(a, b, t)
        apart = np.linalg.norm(matches.uv_a[ahead][:, None] - frame.depth.uv[None], axis=2)
        nearest = np.argmin(apart, axis=1)
        beside = apart.min(axis=1) <= _REACH
        return np.asarray((frame.depth.depth[nearest] / told)[beside])
    return np.empty(0)

"""Are depths that come with the frames in the unit of the true poses, or of T_CF where there are none?

Two images whose poses are known place their matches in space; a depth beside a match tells the same.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from collabslam.checks.lengths import NEAR
from collabslam.checks.matching import LEAST_MATCHES, describe, in_front, match_points
from collabslam.checks.mistakes import MirroredCamera, PoseMistake, undone
from collabslam.checks.robot import LEAST_BASELINE, RobotReport
from collabslam.checks.samples import spread
from collabslam.datasets.at_frames import AtFrames
from collabslam.frontend.epipolar import inverse_ranges
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Image

FRAMES, _ASKED = 12, 48
"""Frames that are asked; more of those of which few have a view of Cf."""
_GAPS = (20, 10, 5, 3, 2)
_REACH = 4.0
"""Pixels from a match to a depth that is taken for its own."""


def check_depth(recording: AtFrames, robot: RobotReport, undo: PoseMistake | None) -> list[str]:
    """What is wrong with the unit of the depths, in a sentence; nothing where nothing tells it.

    Parameters
    ----------
    recording : AtFrames
    robot : RobotReport
        What was found of Cs.
    undo : PoseMistake or None
        What was found of T_CF, undone here as well.
    """
    if not recording.has_depth:
        return []
    by_truth = robot.poses is not None and bool(robot.by_gap)
    every = np.concatenate(
        [
            _ratios(
                recording, robot, i, _frames(recording, robot, i) if by_truth else _views(recording, i, undo)
            )
            for i in spread(range(len(recording)), FRAMES if by_truth else _ASKED)
        ]
    )
    if len(every) < LEAST_MATCHES:
        return []
    ratio = float(np.median(every))
    if abs(np.log(ratio)) < np.log(NEAR):
        return []
    told, those = ("the true poses tell", "those are") if by_truth else ("T_CF tells", "that is")
    return [
        f"The depths of the frames are {ratio:.3g} times as long as {told}: if {those} in metres, "
        f"--depth-scale is to be {ratio:.3g} times what was taken."
    ]


_Other = tuple[Image, MirroredCamera, Array]
"""Another image of the scene, its camera, and the pose of that in this one's."""


def _frames(recording: AtFrames, robot: RobotReport, i: int) -> Iterator[_Other]:
    """Frames near frame ``i``, under the true poses."""
    poses = robot.poses
    assert poses is not None
    for j in (i + way * gap for gap in _GAPS for way in (1, -1)):
        if 0 <= j < len(recording) and np.isfinite(poses[[i, j]]).all():
            yield recording.image(j), robot.model, pose_inverse(poses[i]) @ poses[j]


def _views(recording: AtFrames, i: int, undo: PoseMistake | None) -> Iterator[_Other]:
    """The view of Cf that frame ``i`` has, under T_CF."""
    worn = recording.view(i)
    if worn is not None and recording.worn_camera is not None:
        t_cf = recording.moved(i) @ undone(undo, worn.t_cf)
        yield worn.image, MirroredCamera(recording.worn_camera), t_cf


def _ratios(recording: AtFrames, robot: RobotReport, i: int, others: Iterator[_Other]) -> Array:
    """Depth over what another image tells, for the matches of frame ``i`` beside which there is one."""
    model, frame = robot.model, recording.frame(i)
    if frame.depth is None or not len(frame.depth.depth):
        return np.empty(0)
    for image, other, t in others:
        if np.linalg.norm(t[:3, 3]) < LEAST_BASELINE:
            continue
        matches = match_points(describe(frame.image), describe(image))
        ahead = in_front(matches, model, other, t) == 1.0
        if ahead.sum() < LEAST_MATCHES:
            continue
        rays = model.rays(matches.uv_a[ahead]), other.rays(matches.uv_b[ahead])
        a, b = (r / np.linalg.norm(r, axis=1, keepdims=True) for r in rays)
        told = a[:, 2] / inverse_ranges(a, b, t)
        apart = np.linalg.norm(matches.uv_a[ahead][:, None] - frame.depth.uv[None], axis=2)
        nearest = np.argmin(apart, axis=1)
        beside = apart.min(axis=1) <= _REACH
        return np.asarray((frame.depth.depth[nearest] / told)[beside])
    return np.empty(0)

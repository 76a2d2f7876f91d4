"""Views of the worn camera, sampled from a recording with the frames around them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam.checks.matching import LEAST_MATCHES, Matches, Points, describe, match_points
from collabslam.checks.mistakes import mirrored
from collabslam.checks.robot import CLOCK
from collabslam.checks.samples import spread
from collabslam.datasets.at_frames import AtFrames
from collabslam.types import Array, Image

VIEWS = 12


@dataclass(frozen=True)
class View:
    """A view of Cf: its matches with, and its poses at, frames of Cs around it by their distance in frames.

    Attributes
    ----------
    index : int
    block : int
        Number of the stretch without a gap in which Cf was there.
    matches : dict of int to Matches
        Of Cs's image so many frames later with the view.
    poses : dict of int to (4, 4) array
        ``T_CF`` as it was given so many frames later.
    moved : (4, 4) array
        Cs at the view's own time in Cs at the frame: ``moved @ T_CF`` is where Cf was, seen from the frame.
    covariance : (6, 6) array
    """

    index: int
    block: int
    matches: dict[int, Matches]
    poses: dict[int, Array]
    moved: Array
    covariance: Array


def sample_views(recording: AtFrames) -> list[View]:
    """Views of Cf that share points with Cs, spread over the recording, with the frames around them."""
    between = float(np.median(np.diff(recording.times))) if len(recording) > 1 else np.inf
    step = max(1, round(CLOCK / 3.0 / between)) if np.isfinite(between) else 1
    points: dict[int, Points] = {}

    def of_robot(k: int) -> Points:
        if k not in points:
            points[k] = describe(recording.image(k))
        return points[k]

    asked = {i: recording.view(i) for i in spread(range(len(recording)), 4 * VIEWS)}
    block_of, block = {}, 0
    for i, worn in asked.items():
        block += worn is None
        block_of[i] = block
    views: list[View] = []
    used: set[float] = set()
    there = {i: worn for i, worn in asked.items() if worn is not None}
    for i in spread(list(there), VIEWS):
        worn = there[i]
        if worn.t is not None:  # one may be the nearest of several frames
            if worn.t in used:
                continue
            used.add(worn.t)
        seen, found = _matched(of_robot(i), worn.image)
        if len(found.uv_a) < LEAST_MATCHES:
            continue
        around = [m for m in (step * n for n in range(-3, 4)) if 0 <= i + m < len(recording)]
        matches = {m: match_points(of_robot(i + m), seen) for m in around if m}
        poses = {m: w.t_cf for m in around if (w := recording.view(i + m)) is not None}
        views.append(View(i, block_of[i], {**matches, 0: found}, poses, recording.moved(i), worn.covariance))
    return views


def _matched(robot: Points, worn: Image) -> tuple[Points, Matches]:
    """Points of a view and their matches; those of the mirrored view if it is that one which looks alike."""
    plain = describe(worn)
    found = match_points(robot, plain)
    if len(found.uv_a) >= LEAST_MATCHES:
        return plain, found
    turned = describe(mirrored(worn, across=True, down=False))
    back = np.column_stack([worn.shape[1] - 1 - turned.uv[:, 0], turned.uv[:, 1]])
    turned = Points(back, turned.described)
    return turned, match_points(robot, turned)

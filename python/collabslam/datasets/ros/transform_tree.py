"""ROS's tree of frames, tf: how one frame lies in another at an instant."""

from __future__ import annotations

import bisect
from typing import Any

import numpy as np

from collabslam.datasets.ros.messages import pose_of, stamp_seconds
from collabslam.errors import DataError
from collabslam.geometry import pose_inverse, se3_exp, se3_log
from collabslam.types import Array

KEPT, FRAMES, DEEPEST = 500, 200, 32
"""Samples of each link, links, and links from a frame to the root of its tree that are kept at most."""
GAP = 0.5
"""Seconds between two samples of a link over which it is not interpolated."""


class TransformTree:
    """What tf has told: for each frame its parent, and how it lies in it over time.

    Parameters
    ----------
    kept : int or None
        Samples of each link that are kept; all of them if None.
    """

    def __init__(self, kept: int | None = KEPT) -> None:
        self._kept = kept
        self._parents: dict[str, str] = {}
        self._times: dict[str, list[float]] = {}
        self._poses: dict[str, list[Array]] = {}

    def take(self, message: Any, *, static: bool) -> None:
        """A TFMessage; links that are ``static`` hold for all times.

        Raises
        ------
        DataError
            If a transform is impossible, or there are more than `FRAMES` links.
        """
        for link in message.transforms:
            child, parent = _name(link.child_frame_id), _name(link.header.frame_id)
            pose = pose_of(link.transform, f"tf from {parent} to {child}")
            if child not in self._parents and len(self._parents) >= FRAMES:
                raise DataError(f"tf links more than {FRAMES} frames; leave some out.")
            if static or self._parents.get(child) != parent:
                self._times[child], self._poses[child] = [], []
            self._parents[child] = parent
            t = -np.inf if static else stamp_seconds(link, 0)
            times, poses = self._times[child], self._poses[child]
            at = bisect.bisect_left(times, t)
            times.insert(at, t)
            poses.insert(at, pose)
            if self._kept is not None and len(times) > self._kept:
                del times[0], poses[0]

    def between(self, target: str, source: str, t: float) -> Array | None:
        """Maps points (4, 4) of ``source`` into ``target`` at ``t`` seconds; None where tf does not tell."""
        paths = [self._path_up(_name(frame)) for frame in (target, source)]
        common = next((frame for frame in paths[0] if frame in paths[1]), None)
        if common is None:
            return None
        ups = []
        for path in paths:
            up = np.eye(4)
            for frame in path[: path.index(common)]:
                step = self._at(frame, t)
                if step is None:
                    return None
                up = step @ up
            ups.append(up)
        return np.asarray(pose_inverse(ups[0]) @ ups[1])

    def _path_up(self, frame: str) -> list[str]:
        """The frame, its parent, and so on to the root."""
        path = [frame]
        while path[-1] in self._parents and len(path) <= DEEPEST:
            path.append(self._parents[path[-1]])
        return path

    def _at(self, frame: str, t: float) -> Array | None:
        times, poses = self._times[frame], self._poses[frame]
        if times[0] == -np.inf:
            return poses[0]
        k = bisect.bisect_left(times, t)
        if k < len(times) and times[k] == t:
            return poses[k]
        if k == 0 or k == len(times) or times[k] - times[k - 1] > GAP:
            return None
        share = (t - times[k - 1]) / (times[k] - times[k - 1])
        return np.asarray(poses[k - 1] @ se3_exp(share * se3_log(pose_inverse(poses[k - 1]) @ poses[k])))


def _name(frame: str) -> str:
    return str(frame).lstrip("/")

"""T_CF from ROS's tf: the tree of frames while it changes, and images of Cf that wait for their pose."""

from __future__ import annotations

import bisect
from collections import deque
from typing import Any

import numpy as np

from collabslam.datasets.ros.messages import pose_of
from collabslam.errors import DataError, SettingsError
from collabslam.geometry import pose_inverse, se3_exp, se3_log
from collabslam.live.messages import stamp_of
from collabslam.live.pairing import WAITING
from collabslam.types import Array

KEPT, FRAMES, DEEPEST = 500, 200, 32
"""Samples of each link, links, and links from a frame to the root of its tree that are kept at most."""
GAP = 0.5
"""Seconds between two samples of a link over which it is not interpolated."""


class TransformTree:
    """What tf has told: for each frame its parent, and how it lies in it over time."""

    def __init__(self) -> None:
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
            t = -np.inf if static else stamp_of(link)
            times, poses = self._times[child], self._poses[child]
            at = bisect.bisect_left(times, t)
            times.insert(at, t)
            poses.insert(at, pose)
            if len(times) > KEPT:
                del times[0], poses[0]

    def between(self, target: str, source: str, t: float) -> Array | None:
        """Maps points (4, 4) of ``source`` into ``target`` at ``t`` seconds; None where tf does not tell."""
        ways = [self._way(_name(frame)) for frame in (target, source)]
        common = next((frame for frame in ways[0] if frame in ways[1]), None)
        if common is None:
            return None
        ups = []
        for way in ways:
            up = np.eye(4)
            for frame in way[: way.index(common)]:
                step = self._at(frame, t)
                if step is None:
                    return None
                up = step @ up
            ups.append(up)
        return np.asarray(pose_inverse(ups[0]) @ ups[1])

    def _way(self, frame: str) -> list[str]:
        """The frame, its parent, and so on to the root."""
        way = [frame]
        while way[-1] in self._parents and len(way) <= DEEPEST:
            way.append(self._parents[way[-1]])
        return way

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


class WaitingStamps:
    """Instants of Cf whose pose tf will tell.

    Parameters
    ----------
    sd : tuple of float
        Standard deviations of T_CF as tf has it: of each coordinate (metres), and about each axis (degrees).
        tf tells none.

    Raises
    ------
    SettingsError
        If they are not positive.
    """

    def __init__(self, sd: tuple[float, float]) -> None:
        if not all(0.0 < s < np.inf for s in sd):
            raise SettingsError(f"The standard deviations of T_CF are {sd}; give metres and degrees above 0.")
        self.tree = TransformTree()
        self._covariance = np.diag([sd[0] ** 2] * 3 + [np.deg2rad(sd[1]) ** 2] * 3)
        self._waiting: deque[tuple[float, str]] = deque(maxlen=WAITING)

    def add(self, stamp: float, frame: str) -> None:
        """An image was taken at ``stamp`` by the camera of that frame."""
        self._waiting.append((stamp, frame))

    def known(self, robot_frame: str) -> list[tuple[float, Array, Array]]:
        """Stamp, T_CF (4, 4) and covariance (6, 6) of each instant that tf tells by now; the others wait."""
        found = []
        for stamp, frame in list(self._waiting):
            t_cf = self.tree.between(robot_frame, frame, stamp)
            if t_cf is not None:
                found.append((stamp, t_cf, self._covariance))
                self._waiting.remove((stamp, frame))
        return found


def _name(frame: str) -> str:
    return str(frame).lstrip("/")

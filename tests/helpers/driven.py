"""The demo's first seconds with a robot's wheels, and transforms as ROS sends them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from helpers.clip import Clip

from collabslam.datasets.odometry import increments, mounted
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.geometry import pose_inverse
from collabslam.live import messages
from collabslam.types import Frame, Image, Odometry

RATE = 50
COVARIANCE = np.diag([2e-2, 2e-2, 2e-2, 1e-2, 1e-2, 1e-2]) ** 2
T_BC = mounted((0.2, 0.0, 0.9, 0.0, 5.0, 0.0))


def wheels(clip: Clip, *, t_bc: np.ndarray = T_BC) -> Odometry:
    """Odometry without errors of the demo's first seconds."""
    times = np.arange(0, int(clip.frames[-1].t * RATE) + 2) / RATE - 0.01
    bases = np.stack([clip.recording.robot(float(t)) @ pose_inverse(t_bc) for t in times])
    twists = increments(times, bases, np.zeros(6))
    return Odometry(times, twists, np.tile(COVARIANCE, (len(times), 1, 1)), t_bc)


class Driven(WrappedRecording):
    """The demo's first frames with odometry; some of them are black."""

    def __init__(self, clip: Clip, odometry: Odometry | None, dark: range = range(0)) -> None:
        super().__init__(clip.recording)
        count = len(clip.frames)
        self.times, self.truth = self.times[:count], clip.recording.truth[:count]
        self.odometry, self._frames, self._dark = odometry, clip.frames, dark

    def __len__(self) -> int:
        return len(self._frames)

    def image(self, i: int) -> Image:
        return self.frame(i).image

    def frame(self, i: int) -> Frame:
        frame = self._frames[i]
        return replace(frame, image=0 * frame.image, views=()) if i in self._dark else frame


def tf(*links: tuple[str, str, float, np.ndarray]) -> Any:
    """A TFMessage of (parent, child, stamp, pose of the child in the parent)."""
    whole = []
    for parent, child, t, matrix in links:
        place = messages.maker().pose(matrix)
        vector = messages.make("geometry_msgs/msg/Vector3", *vars(place.position).values())
        transform = messages.make("geometry_msgs/msg/Transform", vector, place.orientation)
        header = messages.header(t, parent)
        whole.append(messages.make("geometry_msgs/msg/TransformStamped", header, child, transform))
    return messages.make(messages.TRANSFORMS, whole)

"""The study's changes to a worn camera that always looks along: how often, how much, how well it is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from collabslam._core import Camera
from collabslam.datasets import attach_worn
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.geometry import pose_inverse, se3_exp
from collabslam.types import Frame, Recording
from collabslam_lab.paper_worlds.poses import WithPoses
from collabslam_lab.worlds import WorldRecording

AVAILABLE = 0.4
"""Share of the time in which the worn camera is there, where that is not what varies."""
PERIOD = 2.5
"""Seconds from one time that it is there to the next."""
POSITION_SD, ANGLE_SD = 0.03, 1.0
"""Metres; degrees about the vertical, half of it about the other axes, where that is not what varies."""


@dataclass(frozen=True)
class Variant:
    """One point of a curve.

    Attributes
    ----------
    factor : {"availability", "overlap", "position_sd", "angle_sd"}
    value : float
        Share of time; share of Cf's picture, along each side, that is left; metres; degrees.
    mode : {"collab", "mono"}
        `mono` has Cf in the first frame only.
    """

    factor: str
    value: float
    mode: str = "collab"

    @property
    def values(self) -> tuple[float, float, float, float]:
        """Of all four factors; where curves cross, variants have the same."""
        usual = {"availability": AVAILABLE, "overlap": 1.0, "position_sd": POSITION_SD, "angle_sd": ANGLE_SD}
        usual[self.factor] = self.value
        available, share, position, angle = usual.values()
        return available, share, position, angle


def varied(world: WorldRecording, held: Recording, variant: Variant, seed: int) -> Recording:
    """The recording with one factor changed; the noise is the same draw, scaled."""
    available, share, position, angle = variant.values
    yaw = np.deg2rad(angle)
    sd = np.array([position, position, position, 0.5 * yaw, yaw, 0.5 * yaw])
    poses = {}
    for i in range(len(world)):
        draw = np.random.Generator(np.random.PCG64((seed, world.recipe.seed, i, 5))).standard_normal(6)
        poses[i] = (world.true_t_cf(i) @ pose_inverse(se3_exp(sd * draw)), np.diag(sd**2), None)
    recording: Recording = WithPoses(held, poses)
    if share < 1.0:
        recording = Cropped(recording, share)
    return attach_worn(recording, "recorded", available=available or 1.0, period=PERIOD)


class Cropped(WrappedRecording):
    """A recording of whose worn pictures only the middle is left, ``share`` of each side."""

    def __init__(self, base: Recording, share: float) -> None:
        super().__init__(base)
        camera = base.worn_camera
        assert camera is not None
        w, h = round(share * camera.width), round(share * camera.height)
        self._x, self._y = (camera.width - w) // 2, (camera.height - h) // 2
        fx, fy, cx, cy = camera.intrinsics
        self.worn_camera = Camera(
            camera.model, w, h, (fx, fy, cx - self._x, cy - self._y), tuple(camera.distortion)
        )

    def frame(self, i: int) -> Frame:
        """Frame ``i`` with the middle of its worn picture."""
        frame, camera = self._base.frame(i), self.worn_camera
        assert camera is not None
        rows, columns = slice(self._y, self._y + camera.height), slice(self._x, self._x + camera.width)
        cut = (replace(v, image=np.ascontiguousarray(v.image[rows, columns])) for v in frame.views)
        return replace(frame, views=tuple(cut))

"""Recordings that nothing was chosen on, made of others: mirrored, played backwards, begun later."""

from __future__ import annotations

import numpy as np

from collabslam import Camera
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.types import Frame, Image, Masks, Recording

MIRRORED, BACKWARDS, LATER = "mirrored", "backwards", "later"
ALTERATIONS = (MIRRORED, BACKWARDS, LATER)
_LATER = 0.35
"""Share of the frames that is left out."""
_MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


class AlteredRecording(WrappedRecording):
    """The images and poses of Cs, altered, and nothing else of a recording: what else is told no longer fits.

    Parameters
    ----------
    base : Recording
    how : str
        One of `ALTERATIONS`: left and right exchanged, in the world too; the last frame first, at the same
        distances in time; or without the first third.
    """

    def __init__(self, base: Recording, how: str) -> None:
        super().__init__(base)
        first = int(_LATER * len(base)) if how == LATER else 0
        self._frames = list(range(first, len(base)))[:: -1 if how == BACKWARDS else 1]
        self._mirrored = how == MIRRORED
        times = np.asarray(base.times)[self._frames]
        self.times = 2.0 * times[0] - times if how == BACKWARDS else times
        self.truth = None if base.truth is None else np.asarray(base.truth)[self._frames]
        if self._mirrored:
            self.camera = _mirrored(base.camera)
            self.truth = None if self.truth is None else _MIRROR @ self.truth @ _MIRROR
            mask = self.masks.robot
            self.masks = Masks(None if mask is None else np.ascontiguousarray(mask[:, ::-1]))
        self.worn_camera = self.target = self.odometry = self.imu = self.t_bs = None
        self.rig_used = self.has_depth = False

    def __len__(self) -> int:
        return len(self._frames)

    def image(self, i: int) -> Image:
        """As of the recording that it is made of."""
        image = self._base.image(self._frames[i])
        return np.ascontiguousarray(image[:, ::-1]) if self._mirrored else image

    def frame(self, i: int) -> Frame:
        """Without views and depths."""
        return Frame(i, float(self.times[i]), self.image(i))


def _mirrored(camera: Camera) -> Camera:
    fx, fy, cx, cy = camera.intrinsics
    distortion = list(camera.distortion)
    if camera.model == "radtan" and len(distortion) > 3:
        distortion[3] *= -1.0  # the tangential one along x
    return Camera(
        camera.model, camera.width, camera.height, [fx, fy, camera.width - 1.0 - cx, cy], distortion
    )

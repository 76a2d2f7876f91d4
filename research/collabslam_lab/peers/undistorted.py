"""A recording whose images of Cs have no distortion, so that every system can be told what its camera is."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.types import Frame, Image, Recording


class Undistorted(WrappedRecording):
    """A recording seen through a pinhole with the same focal length and centre; Cf stays as it is.

    Parameters
    ----------
    base : Recording
    """

    def __init__(self, base: Recording) -> None:
        super().__init__(base)
        bent = base.camera
        self.camera = Camera("pinhole", bent.width, bent.height, bent.intrinsics)
        self._maps: tuple[np.ndarray, np.ndarray] | None = None
        if bent.model != "pinhole":
            u, v = np.meshgrid(np.arange(bent.width), np.arange(bent.height))
            fx, fy, cx, cy = bent.intrinsics
            rays = np.column_stack([(u.ravel() - cx) / fx, (v.ravel() - cy) / fy, np.ones(u.size)])
            seen = bent.project(rays)
            pixels = np.where(seen.visible[:, None], seen.uv, -1e4).astype(np.float32)
            x, y = pixels.T.reshape(2, bent.height, bent.width)
            self._maps = np.ascontiguousarray(x), np.ascontiguousarray(y)

    def image(self, i: int) -> Image:
        """The (H, W) uint8 image of Cs in frame ``i``; black where the camera saw nothing."""
        return self._straight(self._base.image(i))

    def frame(self, i: int) -> Frame:
        """Frame ``i``."""
        frame = self._base.frame(i)
        return replace(frame, image=self._straight(frame.image))

    def _straight(self, image: Image) -> Image:
        if self._maps is None:
            return image
        return np.asarray(cv2.remap(image, *self._maps, cv2.INTER_LINEAR), np.uint8)

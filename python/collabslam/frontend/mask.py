"""What is never scene in a camera's images: the robot's own arm, a hood, the edge of a round picture."""

from __future__ import annotations

import cv2
import numpy as np

from collabslam.frontend.patch import SIZE
from collabslam.types import Array, Mask


class StaticMask:
    """Which pixels of a camera's images are never scene, or so near to that that a patch would show it.

    Parameters
    ----------
    mask : (H, W) bool
        True where there may be scene; see `collabslam.images.check_mask`.
    """

    def __init__(self, mask: Mask) -> None:
        self._hidden = cv2.dilate((~mask).view(np.uint8), np.ones((SIZE, SIZE), np.uint8)) != 0

    def hides(self, uv: Array) -> Mask:
        """Which pixels (N, 2) it hides: (N,) bool; none outside of the image."""
        height, width = self._hidden.shape
        with np.errstate(invalid="ignore"):
            inside = ((uv >= -0.5) & (uv < [width - 0.5, height - 0.5])).all(axis=1)
        out = np.zeros(len(uv), np.bool_)
        at = np.rint(uv[inside]).astype(np.int64)
        out[inside] = self._hidden[at[:, 1], at[:, 0]]
        return out

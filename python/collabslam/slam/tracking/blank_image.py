"""Blank and frozen images: they show nothing new and must not count as a measurement."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import cv2
import numpy as np

from collabslam.formats.schema import Check, array, optional
from collabslam.settings.frontend import BlankImageSettings
from collabslam.slam.state import PersistentState
from collabslam.types import Image

CLEAR, BLANK, FROZEN = "", "blank", "frozen"
_SHRINK = 8
"""Noise of single pixels is averaged over squares of this side before the contrast is taken."""


class BlankImageDetector(PersistentState):
    """Judges the images of one camera, one after the other.

    Parameters
    ----------
    settings : BlankImageSettings
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {"_last": optional(array("|u1", None, None))}

    def __init__(self, settings: BlankImageSettings) -> None:
        self._settings = settings
        self._last: Image | None = None

    def judge(self, image: Image) -> str:
        """`CLEAR`, `BLANK` (black, white, fogged: no contrast) or `FROZEN` (to the bit the last clear one).

        No sensor delivers the same noise twice: an image that repeats the last one comes from a driver that
        hangs.  Measured, it would tell the filter with great certainty that nothing has moved.
        """
        if self._last is not None and _equal(image, self._last):
            return FROZEN
        size = (max(1, image.shape[1] // _SHRINK), max(1, image.shape[0] // _SHRINK))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        if float(cv2.meanStdDev(small)[1][0, 0]) < self._settings.min_contrast:
            return BLANK
        self._last = image.copy()
        return CLEAR


def _equal(a: Image, b: Image) -> bool:
    """Whether two images are the same to the bit; most that are not differ in the middle row already."""
    middle = len(a) // 2
    return a.shape == b.shape and np.array_equal(a[middle], b[middle]) and np.array_equal(a, b)

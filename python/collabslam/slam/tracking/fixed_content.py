"""What the image shows of the camera's own surroundings: a hood, dirt on the lens, an overlay (METHOD 5).

It stays in its place while the camera turns, as no point of the world does.  The filter finds it out by
candidates; what is near them in the image is left alone for a while.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from collabslam._core import LARGEST_PIXEL, Camera
from collabslam.formats.schema import Check, array, refuse
from collabslam.slam.state import PersistentState
from collabslam.types import Array, Mask

_REACH = 0.05
"""Around each point that was found out, as a share of the image's width."""
_FRAMES = 100
"""That a place is left alone: dirt is wiped off and an arm is withdrawn; what stays is found out again."""
_MOST = 500
"""Places kept, the latest."""


class FixedContent(PersistentState):
    """Places of the image where nothing is searched and nothing is born.

    Parameters
    ----------
    camera : Camera
        Cs.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_places": array("<f8", None, 2),
        "_left": array("<i8", None),
    }

    def __init__(self, camera: Camera) -> None:
        self._reach = _REACH * camera.width
        self._places = np.empty((0, 2))
        self._left = np.empty(0, np.int64)  # frames for each of them

    def restore(self, state: Mapping[str, object]) -> None:
        """As `PersistentState.restore`."""
        super().restore(state)
        if len(self._places) != len(self._left) or len(self._left) > _MOST:
            refuse("places fixed to the camera", "as many as their frames, 500 at most")
        if np.abs(self._places).max(initial=0.0) > LARGEST_PIXEL:
            refuse("places fixed to the camera", "pixels")

    @property
    def is_there(self) -> bool:
        """Whether there are such places."""
        return len(self._places) > 0

    def hides(self, uv: Array) -> Mask:
        """Which pixels (N, 2) are near such a place: (N,) bool."""
        off = uv[:, None, :] - self._places[None]
        return np.asarray((off * off).sum(axis=2).min(axis=1, initial=np.inf) < self._reach**2)

    def adopt(self, fixed: Array) -> None:
        """At the end of a frame: pixels (N, 2) of what it showed to be fixed to the camera."""
        keep = self._left > 1
        left = np.concatenate([self._left[keep] - 1, np.full(len(fixed), _FRAMES, np.int64)])
        self._places = np.concatenate([self._places[keep], fixed])[-_MOST:]
        self._left = left[-_MOST:]

"""A recording whose frames are made once and kept."""

from __future__ import annotations

from collections.abc import Callable

from collabslam.datasets.wrapped import WrappedRecording
from collabslam.types import Frame, Image, Recording


class HeldRecording(WrappedRecording):
    """A recording with every frame in memory, so that several runs share one rendering.

    Parameters
    ----------
    base : Recording
    rendered : callable, optional
        Called after each frame.
    """

    def __init__(self, base: Recording, rendered: Callable[[], object] | None = None) -> None:
        super().__init__(base)
        self._frames: list[Frame] = []
        for i in range(len(base)):
            self._frames.append(base.frame(i))
            if rendered is not None:
                rendered()

    def frame(self, i: int) -> Frame:
        """Frame ``i``, from memory."""
        return self._frames[i]

    def image(self, i: int) -> Image:
        """The (H, W) uint8 image of Cs in frame ``i``."""
        return self._frames[i].image

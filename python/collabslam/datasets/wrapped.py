"""A recording around another one, for those that change a part of it."""

from __future__ import annotations

from dataclasses import replace

from collabslam._core import Camera
from collabslam.errors import SettingsError
from collabslam.types import Array, Frame, Image, Odometry, Recording, Target

TOGETHER = 0.01
"""Seconds between two images that count as taken together."""


class WrappedRecording:
    """A :class:`collabslam.types.Recording` that is another one; subclasses change what they differ in.

    Parameters
    ----------
    base : Recording
    """

    def __init__(self, base: Recording) -> None:
        self._base = base
        self.name: str = base.name
        self.source: str = base.source
        self.camera: Camera = base.camera
        self.worn_camera: Camera | None = base.worn_camera
        self.times: Array = base.times
        self.truth: Array | None = base.truth
        self.target: Target | None = base.target
        self.left_out: int = getattr(base, "left_out", 0)
        self.rig_used: bool = getattr(base, "rig_used", False)
        self.odometry: Odometry | None = getattr(base, "odometry", None)
        self.has_depth: bool = getattr(base, "has_depth", False)

    def __len__(self) -> int:
        return len(self._base)

    def image(self, i: int) -> Image:
        """The (H, W) uint8 image of Cs in frame ``i``."""
        return self._base.image(i)

    def frame(self, i: int) -> Frame:
        """Frame ``i``."""
        return self._base.frame(i)


class Together(WrappedRecording):
    """A recording with those views of Cf alone that were taken together with their frame, within 10 ms.

    Parameters
    ----------
    base : Recording
    """

    def frame(self, i: int) -> Frame:
        """Frame ``i``, without a view of another time."""
        frame = self._base.frame(i)
        if frame.worn is None or frame.worn.t is None or abs(frame.worn.t - frame.t) <= TOGETHER:
            return frame
        return replace(frame, worn=None)


class FirstFrames(WrappedRecording):
    """The first frames of a recording.

    Parameters
    ----------
    base : Recording
    count : int
        How many; all of them if there are fewer.

    Raises
    ------
    SettingsError
        If there would be none.
    """

    def __init__(self, base: Recording, count: int) -> None:
        super().__init__(base)
        if count < 1:
            raise SettingsError(f"The largest number of frames is {count}; give 1 or more.")
        self.times = base.times[:count]
        self.truth = None if base.truth is None else base.truth[:count]

    def __len__(self) -> int:
        return len(self.times)

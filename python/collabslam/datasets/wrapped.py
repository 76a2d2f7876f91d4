"""A recording around another one, for those that change a part of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from collabslam._core import Camera
from collabslam.errors import SettingsError
from collabslam.types import (
    Array,
    Frame,
    Image,
    ImuLog,
    Masks,
    Odometry,
    Recording,
    Target,
    masks_of,
    worn_cameras,
)

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
        self.worn_cameras: dict[str, Camera] = worn_cameras(base)
        self.times: Array = base.times
        self.truth: Array | None = base.truth
        self.target: Target | None = base.target
        self.left_out: int = getattr(base, "left_out", 0)
        self.rig_used: bool = getattr(base, "rig_used", False)
        self.worn_pose: str = getattr(base, "worn_pose", "")
        self.odometry: Odometry | None = getattr(base, "odometry", None)
        self.imu: ImuLog | None = getattr(base, "imu", None)
        self.worn_imu: dict[str, ImuLog] = dict(getattr(base, "worn_imu", {}))
        self.t_bs: Array | None = getattr(base, "t_bs", None)
        self.masks: Masks = masks_of(base)
        self.has_depth: bool = getattr(base, "has_depth", False)

    @property
    def worn_camera(self) -> Camera | None:
        """Calibration of the first Cf; set, it is that of the only one."""
        return next(iter(self.worn_cameras.values()), None)

    @worn_camera.setter
    def worn_camera(self, camera: Camera | None) -> None:
        self.worn_cameras, self.worn_imu = {} if camera is None else {"": camera}, {}

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
        """Frame ``i``, without views of another time."""
        frame = self._base.frame(i)
        together = (v for v in frame.views if v.t is None or abs(v.t - frame.t) <= TOGETHER)
        return replace(frame, views=tuple(together))


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


class OnlyPersons(WrappedRecording):
    """A recording with the worn cameras of some of its persons alone.

    Parameters
    ----------
    base : Recording
    names : iterable of str
        At least one.

    Raises
    ------
    SettingsError
        If one of them is none of the recording's, or there is none.
    """

    def __init__(self, base: Recording, names: Iterable[str]) -> None:
        super().__init__(base)
        there, names = worn_cameras(base), list(names)
        missing = [name for name in names if name not in there]
        if missing or not names:
            known, wanted = (", ".join(map(repr, some)) or "nobody" for some in (there, missing))
            raise SettingsError(f"{base.name} has no worn camera of {wanted}; there are those of {known}.")
        self.worn_cameras = {name: camera for name, camera in there.items() if name in names}
        of_worn = {name: mask for name, mask in self.masks.worn.items() if name in names}
        self.masks = replace(self.masks, worn=of_worn)

    def frame(self, i: int) -> Frame:
        """Frame ``i`` with their views."""
        frame = self._base.frame(i)
        return replace(frame, views=tuple(v for v in frame.views if v.who in self.worn_cameras))

"""The pictures of a recording whose camera nobody has calibrated yet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, overload

from collabslam.datasets.images import decode_grey, list_images
from collabslam.datasets.opening import is_known, open_given
from collabslam.datasets.overrides import Given
from collabslam.datasets.readers import folder, video
from collabslam.datasets.ros.bag import CAMERA_TYPE, Bag, BagImages, is_bag
from collabslam.datasets.ros.reader import only_images
from collabslam.types import Image


@dataclass(frozen=True)
class Pictures:
    """Images by number.

    Attributes
    ----------
    source : Path
    count : int
    read : callable
        The (H, W) uint8 grey image of a number.
    first : Path or None
        File of the first one, where it is a file.
    """

    source: Path
    count: int
    read: Callable[[int], Image]
    first: Path | None = None

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the first one."""
        height, width = self.read(0).shape
        return width, height


@overload
def open_pictures(source: Path, given: Given) -> Pictures: ...
@overload
def open_pictures(source: Path, given: Given, *, only_uncalibrated: Literal[True]) -> Pictures | None: ...
def open_pictures(source: Path, given: Given, *, only_uncalibrated: bool = False) -> Pictures | None:
    """The pictures of a folder, a video, a bag or any recording.

    Parameters
    ----------
    source : Path
    given : Given
        Of a bag, the topic ``cs``.
    only_uncalibrated : bool
        None for a recording that brings its calibration with it.

    Raises
    ------
    DataError
        If there are none, or they cannot be read.
    """
    if video.matches(source):
        film = video.Video(source)
        return Pictures(source, len(film.times), film.read)
    images = folder.images_of(source) if source.is_dir() else None
    if images is not None and not is_known(source):
        paths = list_images(images)
        return Pictures(source, len(paths), lambda i: decode_grey(paths[i]), paths[0])
    if is_bag(source):
        bag = Bag(source)
        if only_uncalibrated and bag.of_type(CAMERA_TYPE):
            return None
        stream = BagImages(bag, given.topics.get("cs") or only_images(bag))
        return Pictures(source, len(stream.stamps), stream.read)
    if only_uncalibrated:
        return None
    recording = open_given(source, given)
    return Pictures(source, len(recording), recording.image)

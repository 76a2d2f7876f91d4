"""A recording made of image files, which is what every data set on disk becomes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.depth_image import DepthImage
from collabslam.datasets.gate import tell
from collabslam.datasets.image_names import counting
from collabslam.datasets.images import read_grey
from collabslam.datasets.recorded_worn import RecordedWorn, WithWornCameras, views_of
from collabslam.datasets.units import UNITS, as_seconds, looks_dated, read_stamps
from collabslam.errors import DataError, InputError
from collabslam.types import Array, Frame, Image, ImuLog, Masks, Odometry, Recording, Target


@dataclass(frozen=True)
class Rig:
    """The second camera of a rigid rig, which can stand in for a worn camera.

    Attributes
    ----------
    camera : Camera
    t_cf : (4, 4) float64
        From calibration: maps points of the second camera into Cs, metres.
    paths : mapping of frame index to image file
    """

    camera: Camera
    t_cf: Array
    paths: Mapping[int, Path]


@dataclass(frozen=True)
class ImageRecording(WithWornCameras):
    """A :class:`collabslam.types.Recording` whose images are files.

    Attributes
    ----------
    depth : mapping or None
        Depth images by frame index.
    left_out : int
        Frames of the source that are not in it, as their stamps cannot be used; see `ordered.in_order`.
    odometry : Odometry or None
    imu : ImuLog or None
        Samples of the gyroscope that goes with it.
    worn_imu : mapping
        Those of the worn cameras' own, by name: their rates are in the views.
    masks : Masks
        What is never scene.
    t_bs : (4, 4) float64 or None
        Maps points of Cs into the body that the true poses were of, by which they became those of Cs.
    worn : mapping
        What each worn camera took, by the name of whoever wears it; "" is that of a single one.

    Raises
    ------
    DataError
        If there are no images, or counts disagree.
    """

    name: str
    source: str
    camera: Camera
    paths: tuple[Path, ...]
    times: Array
    truth: Array | None = None
    target: Target | None = None
    rig: Rig | None = None
    worn: Mapping[str, RecordedWorn] = field(default_factory=dict)
    depth: Mapping[int, DepthImage] | None = None
    left_out: int = 0
    odometry: Odometry | None = None
    imu: ImuLog | None = None
    t_bs: Array | None = None
    worn_imu: Mapping[str, ImuLog] = field(default_factory=dict)
    masks: Masks = field(default_factory=Masks)

    def __post_init__(self) -> None:
        if len(self.times) != len(self.paths):
            raise DataError(
                f"The recording {self.source} has {len(self.paths)} images but {len(self.times)} time "
                "stamps; match them."
            )
        check_frames(self.source, self.times, self.truth)

    @property
    def has_depth(self) -> bool:
        """Whether frames bring depths with them."""
        return bool(self.depth)

    def __len__(self) -> int:
        return len(self.paths)

    def image(self, i: int) -> Image:
        """The (H, W) uint8 image of Cs in frame ``i``."""
        return read_grey(self.paths[frame_index(self, i)], self.camera)

    def frame(self, i: int) -> Frame:
        """Frame ``i``, with the recorded views of the worn cameras where there are some."""
        i = frame_index(self, i)
        depth = None if self.depth is None else self.depth.get(i)
        points = None if depth is None else depth.points(self.camera)
        return Frame(i, float(self.times[i]), self.image(i), views_of(self.worn, i), points)


def check_frames(source: str, times: Array, truth: Array | None) -> None:
    """Check that there are frames, and that each has its pose; raises DataError naming the recording."""
    if len(times) == 0:
        raise DataError(f"The recording {source} holds no frames; give a folder with images.")
    if truth is not None and len(truth) != len(times):
        raise DataError(f"The recording {source} has {len(times)} images but {len(truth)} poses; match them.")


def frame_index(recording: Recording, i: int) -> int:
    """``i``, or an InputError if there is no such frame."""
    if not 0 <= i < len(recording):
        raise InputError(
            f"The frame {i} does not exist; {recording.name} has the frames 0 to {len(recording) - 1}."
        )
    return int(i)


def times_at_rate(paths: Sequence[Path], rate: float) -> Array:
    """Time stamps of images that carry none: the numbers in their names, from the first, over the frame rate.

    See `counting`; missing images leave gaps, so that the time between frames stays true.  Numbers that are
    as far apart as milli-, micro- or nanoseconds are at that rate count these.

    Parameters
    ----------
    paths
        Image files in order.
    rate
        Frames per second.

    Returns
    -------
    (N,) seconds from the first image

    Raises
    ------
    DataError
        If no numbers increase, or they are dates and times of day, which do not count frames.
    """
    folder = paths[0].parent
    dated = all(_DATED.search(p.name) for p in paths)
    numbers = counting([Path(_DATED.sub("", p.name)) for p in paths] if dated else paths)
    if numbers is None and dated:
        raise DataError(
            f"The images' names, such as {paths[0].name}, are dates and times of day; give --times FILE with "
            "their stamps in seconds."
        )
    if numbers is None:
        raise DataError(
            f"The names of the images in {folder}, from {paths[0].name} to {paths[-1].name}, have no numbers "
            "that increase, and tell no order; number them, or give --times FILE with lines 'stamp,name'."
        )
    step = float(np.median(np.diff(numbers))) if len(numbers) > 1 else 1.0
    for unit, power in list(UNITS.items())[1:]:
        if abs(step * rate * 10.0**power - 1.0) < _NEAR:
            tell("stamps", f"numbers of the images' names, in {unit} (they fit the rate so)", folder)
            return np.asarray([(k - numbers[0]) * 10.0**power for k in numbers], dtype=np.float64)
    tell("stamps", f"numbers of the images' names over {rate:g} a second", folder)
    return np.asarray([(k - numbers[0]) / rate for k in numbers], dtype=np.float64)


_DATED = re.compile(
    r"(?:19|20)[0-9]{2}[-_.]?[01][0-9][-_.]?[0-3][0-9][-_ T]*"
    r"[0-2][0-9][-_.h]?[0-5][0-9][-_.m]?[0-5][0-9][0-9]*"
)
_NEAR = 0.15
"""Share of a frame's interval by which numbers that are times may be off."""


def stamps_in_names(paths: Sequence[Path]) -> Array | None:
    """Seconds that images' names end with, if they are times since 1970 in any unit; None if not."""
    found = [re.search(r"[0-9]+(?:\.[0-9]+)?$", p.stem) for p in paths]
    texts = [match.group() for match in found if match is not None]
    if len(texts) < len(paths) or not all(len(t) > 10 and looks_dated(t) for t in texts):
        return None
    return as_seconds(read_stamps(texts, f"the names in {paths[0].parent}"))

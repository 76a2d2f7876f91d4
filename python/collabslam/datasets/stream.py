"""A recording whose images are not files of their own: a bag, a video."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from collabslam._core import Camera
from collabslam.datasets.calibration import check_resolution
from collabslam.datasets.recorded_worn import RecordedWorn, WithWornCameras, views_of
from collabslam.datasets.recording import check_frames, frame_index
from collabslam.types import Array, DepthPoints, Frame, Image, ImuLog, Masks, Odometry, Target


@dataclass(frozen=True)
class StreamRecording(WithWornCameras):
    """A :class:`collabslam.types.Recording` whose images are read by a function.

    Attributes
    ----------
    read : callable
        Image of Cs in a frame, (H, W) uint8; quick if the frames are asked for in order.
    worn : mapping
        What each worn camera took, by the name of whoever wears it; "" is that of a single one.
    worn_pose : str
        Whether its pose was ``measured``, or ``estimated`` from laser scans and AHRSs.
    read_depth : callable or None
        Depths of a frame, or None; None where the source has none.
    left_out : int
        Frames of the source that are not in it, as their stamps cannot be used; see `ordered.in_order`.
    odometry : Odometry or None
    imu : ImuLog or None
        Samples of the gyroscope that goes with it.
    masks : Masks
        What is never scene.

    Raises
    ------
    DataError
        If there are no frames, or counts disagree.
    """

    name: str
    source: str
    camera: Camera
    times: Array
    read: Callable[[int], Image]
    worn: Mapping[str, RecordedWorn] = field(default_factory=dict)
    worn_pose: str = "measured"
    truth: Array | None = None
    target: Target | None = None
    read_depth: Callable[[int], DepthPoints | None] | None = None
    left_out: int = 0
    odometry: Odometry | None = None
    imu: ImuLog | None = None
    worn_imu: Mapping[str, ImuLog] = field(default_factory=dict)
    masks: Masks = field(default_factory=Masks)

    def __post_init__(self) -> None:
        check_frames(self.source, self.times, self.truth)

    def __len__(self) -> int:
        return len(self.times)

    def image(self, i: int) -> Image:
        """The (H, W) uint8 image of Cs in frame ``i``."""
        image = self.read(frame_index(self, i))
        check_resolution(self.camera, image, f"{i} of {self.source}")
        return image

    def frame(self, i: int) -> Frame:
        """Frame ``i``, with the worn views where there are some."""
        image = self.image(i)
        views = views_of(self.worn, i)
        for view in views:
            check_resolution(self.worn[view.who].camera, view.image, f"of Cf in frame {i} of {self.source}")
        depth = None if self.read_depth is None else self.read_depth(i)
        return Frame(i, float(self.times[i]), image, views, depth)

    @property
    def has_depth(self) -> bool:
        """Whether frames bring depths with them."""
        return self.read_depth is not None

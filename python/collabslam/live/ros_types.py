"""What everything that talks to rclpy needs: the module, message classes, images with their stamps."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from collabslam._core import Camera
from collabslam.datasets.calibration import check_size
from collabslam.datasets.deep_range import RunningRange
from collabslam.datasets.image_header import read_header
from collabslam.datasets.mosaic import RunningMosaic
from collabslam.datasets.ros.messages import extent_in, image_of, said_to_be_grey
from collabslam.errors import CollabslamError, DataError
from collabslam.live import messages
from collabslam.live.decoding import PASSES
from collabslam.types import Image


def rclpy_of() -> Any:
    """The module ``rclpy``; raises DataError if there is none."""
    try:
        return import_module("rclpy")
    except ImportError as error:
        raise DataError(
            f"ROS 2 is not there ({error}); source its setup.bash first, or, with Python 3.11, pip install "
            "ros-rclpy ros-rmw-fastrtps-cpp ros-sensor-msgs ros-nav-msgs ros-geometry-msgs."
        ) from error


def message_class(kind: str) -> Any:
    """The class of a message type of ROS 2; raises DataError if its package is not installed."""
    package, _, name = kind.split("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise DataError(f"The messages {package} of ROS 2 are not installed ({error}).") from error


def image_kind(topic: str) -> str:
    """CompressedImage where the topic's name ends so, Image elsewhere."""
    return messages.COMPRESSED if topic.endswith("compressed") else messages.IMAGE


class ImageTopic:
    """Images of a topic, one after the other.

    Cameras put 10 or 12 bits into pixels of 16 and do not say so: see `RunningRange`.  Whether they are
    mosaics that do not say so, the first ones tell: see `RunningMosaic`.

    Attributes
    ----------
    name : str
    kind : str
        Type of its messages.
    camera : Camera or None
        That takes them, once it is known: a compressed picture of another size is then not decoded.
    """

    def __init__(self, name: str) -> None:
        self.name, self.kind = name, image_kind(name)
        self.camera: Camera | None = None
        self._range = RunningRange()
        self._mosaic = RunningMosaic()

    def stamped(self, data: bytes) -> tuple[float, Image, str]:
        """Stamp (seconds), image (H, W) uint8 and frame of a message in CDR; raises DataError."""
        message = messages.decoded(self.kind, data)
        if self.kind == messages.COMPRESSED:
            self._check(message.data.tobytes())
        mosaic = self._mosaic.of(said_to_be_grey(message, self.name) if self._mosaic.asks else None)
        image = image_of(message, self.name, self._range.of(extent_in(message)), mosaic)
        return messages.stamp_of(message), image, str(message.header.frame_id)

    def _check(self, picture: bytes) -> None:
        """Raises DataError for a picture that costs more than one of its camera, before it is decoded."""
        header = read_header(picture)
        if header is None:
            return  # as the decoder says it
        if header.passes > PASSES:
            raise DataError(f"A picture on {self.name} has {header.passes} scans; send at most {PASSES}.")
        if self.camera is not None:
            check_size(self.camera, (header.width, header.height), f"on {self.name}")


def subscribe(
    node: Any,
    topic: str,
    kind: str,
    take: Callable[[bytes], None],
    refuse: Callable[[CollabslamError], None],
    *,
    latched: bool = False,
) -> Any:
    """Calls ``take`` with each message in CDR, ``refuse`` with what it raises: a message costs itself only.

    Parameters
    ----------
    node
        A ``rclpy`` node.
    latched : bool
        Whether what was sent before is to come, too.
    """

    def guarded(data: bytes) -> None:
        try:
            take(bytes(data))
        except CollabslamError as error:
            refuse(error)

    qos = import_module("rclpy.qos")
    profile = qos.qos_profile_sensor_data
    if latched:
        profile = qos.QoSProfile(depth=100, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)
    return node.create_subscription(message_class(kind), topic, guarded, profile, raw=True)

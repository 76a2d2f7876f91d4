"""What everything that talks to rclpy needs: the module, message classes, images with their stamps."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from collabslam.datasets.images import depth_of
from collabslam.datasets.ros.messages import deepest, image_of
from collabslam.errors import CollabslamError, DataError
from collabslam.live import messages
from collabslam.types import Image

_MANY = 10
"""Images among which the brightest one may be broken."""


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
    except ImportError as error:
        raise DataError(f"The messages {package} of ROS 2 are not installed ({error}).") from error


def image_kind(topic: str) -> str:
    """CompressedImage where the topic's name ends so, Image elsewhere."""
    return messages.COMPRESSED if topic.endswith("compressed") else messages.IMAGE


class ImageTopic:
    """Images of a topic, one after the other.

    Cameras put 10 or 12 bits into pixels of 16 and do not say so: the range is that of the largest value so
    far; from the tenth image on but for the one brightest image, so that a broken pixel costs no more.

    Attributes
    ----------
    name : str
    kind : str
        Type of its messages.
    """

    def __init__(self, name: str) -> None:
        self.name, self.kind = name, image_kind(name)
        self._largest: list[int] = []
        self._count = 0

    def stamped(self, data: bytes) -> tuple[float, Image, str]:
        """Stamp (seconds), image (H, W) uint8 and frame of a message in CDR; raises DataError."""
        message = messages.decoded(self.kind, data)
        self._largest = sorted([*self._largest, deepest(message)])[-2:]
        self._count += 1
        image = image_of(message, self.name, depth_of(self._largest[0 if self._count >= _MANY else -1]))
        return messages.stamp_of(message), image, str(message.header.frame_id)


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

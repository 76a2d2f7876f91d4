"""The same as a node of ROS 2: images and poses come from topics, the pose and the map go to topics.

Messages pass as CDR, as they came: rclpy moves them, rosbags reads and writes them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from collabslam._core import Camera
from collabslam.datasets.ros.messages import image_of
from collabslam.errors import CollabslamError, DataError
from collabslam.live import messages
from collabslam.live.core import LivePose
from collabslam.live.downlink import MAP_EVERY, STATUS_EVERY, status_of
from collabslam.live.pairing import Pairing
from collabslam.live.slam import LiveSlam
from collabslam.settings.table import Settings
from collabslam.slam.engine import Slam
from collabslam.types import Image

NAME = "collabslam"
SESSION = "ros/1"
"""Of the one worn camera that the topics tell of."""


@dataclass(frozen=True)
class RosTopics:
    """Names of topics; images are CompressedImage where the name ends in ``compressed``, Image elsewhere.

    Attributes
    ----------
    cs, cs_info : str
        Images of Cs and their CameraInfo.
    cf, cf_info, t_cf : str or None
        The same of Cf, and T_CF as PoseWithCovarianceStamped with the stamps of Cf's images.
    out : str
        What the published topics' names begin with.
    """

    cs: str
    cs_info: str
    cf: str | None = None
    cf_info: str | None = None
    t_cf: str | None = None
    out: str = "/collabslam"


class RosNode:
    """A node that runs the filter.

    Parameters
    ----------
    node
        A ``rclpy`` node.
    topics : RosTopics
    settings : Settings
    mode : str or None
        The settings' if None.
    start : str
        As of `collabslam.Slam`.

    Raises
    ------
    DataError
        If message types are not installed.
    """

    def __init__(
        self,
        node: Any,
        topics: RosTopics,
        settings: Settings,
        *,
        mode: str | None = None,
        start: str = "worn",
    ) -> None:
        self.poses = 0
        self._settings, self._mode, self._start = settings, mode, start
        self._cameras: dict[str, Camera] = {}
        self._wanted = {"cs"} | ({"cf"} if topics.cf else set())
        self._pairing = Pairing()
        self._live: LiveSlam | None = None
        self._refused = 0
        self._due = dict.fromkeys(("status", "map"), -float("inf"))
        self._kept = []
        takes: list[tuple[str | None, str, Callable[[bytes], None]]] = [
            (topics.cs_info, messages.CAMERA_INFO, lambda data: self._calibration("cs", data)),
            (topics.cf_info, messages.CAMERA_INFO, lambda data: self._calibration("cf", data)),
            (topics.cs, _image_type(topics.cs), lambda data: self._robot(topics.cs, data)),
            (topics.cf, _image_type(topics.cf or ""), lambda data: self._worn(str(topics.cf), data)),
            (topics.t_cf, messages.POSE, lambda data: self._pose(data)),
        ]
        qos = import_module("rclpy.qos").qos_profile_sensor_data
        for topic, kind, take in takes:
            if topic is not None:
                guarded = _guarded(take, self._refuse)
                self._kept.append(node.create_subscription(_type(kind), topic, guarded, qos, raw=True))
        self._out = {
            name: node.create_publisher(_type(kind), f"{topics.out}/{name}", 10)
            for name, kind in (
                ("pose", messages.POSE),
                ("odometry", messages.ODOMETRY),
                ("map", messages.CLOUD),
            )
        }
        for name, kind, topic in (
            ("status", messages.STATUS, "/diagnostics"),
            ("tf", messages.TRANSFORMS, "/tf"),
        ):
            self._offer(node, name, kind, topic)

    def _offer(self, node: Any, name: str, kind: str, topic: str) -> None:
        """A topic of messages that a small ROS may lack."""
        try:
            self._out[name] = node.create_publisher(_type(kind), topic, 10)
        except DataError as error:
            node.get_logger().warning(f"no {topic}: {error}")

    def close(self) -> None:
        """Ends the filter; raises whatever ended it before."""
        if self._live is not None:
            self._live.close()

    def _calibration(self, which: str, data: bytes) -> None:
        if which in self._cameras or self._live is not None:
            return
        self._cameras[which] = messages.camera_from(data, f"CameraInfo of {which}")
        if self._wanted <= self._cameras.keys():
            cameras = self._cameras["cs"], self._cameras.get("cf")
            slam = Slam(*cameras, settings=self._settings, mode=self._mode, start=self._start)
            self._live = LiveSlam(slam, on_pose=self._publish, same_clock=True)

    def _robot(self, topic: str, data: bytes) -> None:
        if self._live is not None:
            self._live.push_robot(*_image(topic, data))

    def _worn(self, topic: str, data: bytes) -> None:
        stamp, image = _image(topic, data)
        self._push(self._pairing.image(SESSION, stamp, image))

    def _pose(self, data: bytes) -> None:
        self._push(self._pairing.pose(*messages.pose_from(data, "T_CF")))

    def _push(self, view: Any) -> None:
        if view is not None and self._live is not None:
            self._live.push(view)

    def _refuse(self, error: CollabslamError) -> None:
        self._refused += 1

    def _publish(self, pose: LivePose) -> None:
        step = pose.step
        if step.valid:
            self._out["pose"].publish(messages.robot_pose(step.t, step.pose, step.covariance))
            self._out["odometry"].publish(messages.odometry(step.t, step.pose, step.covariance))
            if "tf" in self._out:
                self._out["tf"].publish(messages.transform(step.t, step.pose))
            self.poses += 1
        live = self._live
        if live is None:
            return
        if "status" in self._out and self._is_due("status", STATUS_EVERY):
            dropped = {f"dropped {k}": v for k, v in live.dropped.items()} | {"refused": self._refused}
            self._out["status"].publish(status_of(pose, dropped, {}))
        if step.started and self._is_due("map", MAP_EVERY):
            self._out["map"].publish(messages.cloud(step.t, live.slam.landmarks().points))

    def _is_due(self, name: str, every: float) -> bool:
        now = time.monotonic()
        if now - self._due[name] < every:
            return False
        self._due[name] = now
        return True


def rclpy_of() -> Any:
    """The module ``rclpy``; raises DataError if there is none."""
    try:
        return import_module("rclpy")
    except ImportError as error:
        raise DataError(
            f"ROS 2 is not there ({error}); source its setup.bash first, or, with Python 3.11, pip install "
            "ros-rclpy ros-rmw-fastrtps-cpp ros-sensor-msgs ros-nav-msgs ros-geometry-msgs."
        ) from error


def _type(kind: str) -> Any:
    """The class of a message type of ROS 2."""
    package, _, name = kind.split("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except ImportError as error:
        raise DataError(f"The messages {package} of ROS 2 are not installed ({error}).") from error


def _image_type(topic: str) -> str:
    return messages.COMPRESSED if topic.endswith("compressed") else messages.IMAGE


def _image(topic: str, data: bytes) -> tuple[float, Image]:
    message = messages.decoded(_image_type(topic), data)
    return messages.stamp_of(message), image_of(message, topic)


def _guarded(
    take: Callable[[bytes], None], refuse: Callable[[CollabslamError], None]
) -> Callable[[bytes], None]:
    """``take`` for messages that may be broken: each costs itself only."""

    def guarded(data: bytes) -> None:
        try:
            take(bytes(data))
        except CollabslamError as error:
            refuse(error)

    return guarded

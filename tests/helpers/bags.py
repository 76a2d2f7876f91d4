"""Bags of ROS 1 and ROS 2, written message by message."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from collabslam import geometry as g

FRAMES, WIDTH, HEIGHT = 6, 32, 24
START = 1_700_000_000_000_000_000
STEP = 100_000_000
IMAGES = np.random.default_rng(1).integers(0, 256, (FRAMES, HEIGHT, WIDTH), dtype=np.uint8)
KINDS = ("ros1", "sqlite3", "mcap")


class Maker:
    """Writes messages of a kind of bag; messages are given by type and fields."""

    def __init__(self, path: Path, kind: str) -> None:
        self.ros1 = kind == "ros1"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        if self.ros1:
            tf = "tf2_msgs/msg/TFMessage"
            self.store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", tf))
        self.path = path.with_suffix(".bag") if self.ros1 else path
        if self.ros1:
            self.writer: Any = Writer1(self.path)
        else:
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self.writer = Writer2(self.path, version=9, storage_plugin=plugin)
        self.connections: dict[str, Any] = {}

    def make(self, kind: str, *values: Any, **named: Any) -> Any:
        return self.store.types[kind](*values, **named)

    def header(self, stamp: int, frame: str = "cam") -> Any:
        time = self.make("builtin_interfaces/msg/Time", *divmod(stamp, 10**9))
        return self.make("std_msgs/msg/Header", *((0,) if self.ros1 else ()), time, frame)

    def pose(self, matrix: np.ndarray) -> Any:
        w, x, y, z = g.quaternion_wxyz(matrix[:3, :3])
        return self.make("geometry_msgs/msg/Pose", self.make("geometry_msgs/msg/Point", *matrix[:3, 3]),
                         self.make("geometry_msgs/msg/Quaternion", x, y, z, w))  # fmt: skip

    def topic(self, name: str, kind: str) -> Any:
        if name not in self.connections:
            self.connections[name] = self.writer.add_connection(name, kind, typestore=self.store)
        return self.connections[name]

    def write(self, name: str, kind: str, stamp: int, *values: Any, **named: Any) -> None:
        message = self.make(kind, *values, **named)
        data = (self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr)(message, kind)
        self.writer.write(self.topic(name, kind), stamp, bytes(data))

    def image(self, name: str, stamp: int, image: np.ndarray, encoding: str = "mono8") -> None:
        step = image.strides[0]
        self.write(name, "sensor_msgs/msg/Image", stamp + 7_000, self.header(stamp), *image.shape[:2],
                   encoding, 0, step, image.reshape(-1).view(np.uint8))  # fmt: skip

    def camera(self, name: str, stamp: int, k: float = 30.0) -> None:
        values = [self.header(stamp), HEIGHT, WIDTH, "plumb_bob", np.array([-0.1, 0.01, 0.0, 0.0, 0.0]),
                  np.array([k, 0, 15.5, 0, k, 11.5, 0, 0, 1.0]) if k else np.zeros(9),
                  np.eye(3).ravel(), np.zeros(12), 0, 0]  # fmt: skip
        roi = self.make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        self.write(name, "sensor_msgs/msg/CameraInfo", stamp, *values, roi)

    def pose_cov(self, name: str, stamp: int, matrix: np.ndarray, covariance: np.ndarray) -> None:
        pose = self.make("geometry_msgs/msg/PoseWithCovariance", self.pose(matrix), covariance.ravel())
        self.write(name, "geometry_msgs/msg/PoseWithCovarianceStamped", stamp, self.header(stamp), pose)

    def link(self, name: str, stamp: int, parent: str, child: str, matrix: np.ndarray) -> None:
        pose = self.pose(matrix)
        vector = self.make("geometry_msgs/msg/Vector3", *matrix[:3, 3])
        moved = self.make("geometry_msgs/msg/Transform", vector, pose.orientation)
        link = self.make("geometry_msgs/msg/TransformStamped", self.header(stamp, parent), child, moved)
        self.write(name, "tf2_msgs/msg/TFMessage", stamp, [link])

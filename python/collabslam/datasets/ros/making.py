"""Images, calibrations and poses as messages of ROS 2, with the types of a rosbags store."""

from __future__ import annotations

from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.written_numbers import stable_quaternion
from collabslam.errors import DataError
from collabslam.geometry import tangent_to_fixed
from collabslam.types import Array, Image

NANOSECONDS = 10**9
IMAGE, CAMERA_INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_MODELS = {"pinhole": ("plumb_bob", 5), "radtan": ("plumb_bob", 5), "fisheye": ("equidistant", 4)}
"""What ROS calls a camera's model, and how many coefficients it has there; a pinhole's are zero."""


def check_model(camera: Camera | None) -> None:
    """Raises DataError if a camera's model has no name in ROS."""
    if camera is not None and camera.model not in _MODELS:
        raise DataError(
            f"The camera's model '{camera.model}' has no name in ROS; give a pinhole, radtan or fisheye one."
        )


class Maker:
    """Makes messages; stamps are whole nanoseconds.

    Parameters
    ----------
    store
        Of rosbags.
    """

    def __init__(self, store: Any) -> None:
        self._types = store.types

    def make(self, kind: str, *values: Any) -> Any:
        """A message of its fields' values."""
        return self._types[kind](*values)

    def header(self, stamp: int, frame: str) -> Any:
        """A header."""
        time = self.make("builtin_interfaces/msg/Time", *divmod(stamp, NANOSECONDS))
        return self.make("std_msgs/msg/Header", time, frame)

    def image(self, stamp: int, frame: str, image: Image) -> Any:
        """A (H, W) uint8 grey image."""
        h, w = image.shape
        data = np.ascontiguousarray(image).ravel()
        return self.make(IMAGE, self.header(stamp, frame), h, w, "mono8", 0, w, data)

    def camera_info(self, stamp: int, frame: str, camera: Camera) -> Any:
        """A calibration; raises DataError as `check_model` does."""
        check_model(camera)
        model, coefficients = _MODELS[camera.model]
        fx, fy, cx, cy = camera.intrinsics
        k = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        d = np.zeros(coefficients)
        d[: len(camera.distortion)] = camera.distortion
        p = np.concatenate([k.reshape(3, 3), np.zeros((3, 1))], axis=1).ravel()
        roi = self.make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        values = (camera.height, camera.width, model, d, k, np.eye(3).ravel(), p, 0, 0, roi)
        return self.make(CAMERA_INFO, self.header(stamp, frame), *values)

    def pose(self, pose: Array) -> Any:
        """A pose (4, 4); reading it back gives the same bits from the second time on."""
        w, x, y, z = stable_quaternion(pose[:3, :3])
        point = self.make("geometry_msgs/msg/Point", *(float(v) for v in pose[:3, 3]))
        turn = self.make("geometry_msgs/msg/Quaternion", x, y, z, w)
        return self.make("geometry_msgs/msg/Pose", point, turn)

    def pose_with_covariance(self, stamp: int, frame: str, pose: Array, covariance: Array) -> Any:
        """A pose with its covariance (6, 6), tangent on the right; the message's is along fixed axes."""
        fixed = tangent_to_fixed(pose, covariance).ravel()
        value = self.make("geometry_msgs/msg/PoseWithCovariance", self.pose(pose), fixed)
        return self.make(POSE_WITH_COVARIANCE, self.header(stamp, frame), value)

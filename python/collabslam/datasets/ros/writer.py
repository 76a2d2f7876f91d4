"""A recording of two cameras as a ROS 2 bag, with what its sensors read; needs the extra ``ros``.

Topics: ``/cs`` and ``/cf`` with ``image_raw`` and ``camera_info``, ``/t_cf`` (measured pose of Cf in Cs, with
covariance), ``/truth``, and if there are readings ``/front/scan``, ``/back/scan``, ``/cs/imu``, ``/cf/imu``.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.recording_writer import stable_quaternion
from collabslam.errors import DataError
from collabslam.extras import needs
from collabslam.geometry import tangent_to_fixed
from collabslam.types import Array, Image, Recording
from collabslam.worn_pose import AhrsReading, LaserScan
from collabslam.worn_pose.readings import Wearer

TOPICS = {"cs": "/cs/image_raw", "cf": "/cf/image_raw", "t_cf": "/t_cf", "truth": "/truth"}
"""Roles of the topics, as ``collabslam.open_recording(path, topics=...)`` takes them."""
SCAN_TOPIC = "/{}/scan"
AHRS_TOPICS: dict[Wearer, str] = {"robot": "/cs/imu", "worn": "/cf/imu"}
ROBOT, WORN, WORLD = "cs_optical", "cf_optical", "world"

_NANOSECONDS = 10**9
_MODELS = {"pinhole": ("plumb_bob", 5), "radtan": ("plumb_bob", 5), "fisheye": ("equidistant", 4)}
"""What ROS calls a camera's model, and how many coefficients it has there; a pinhole's are zero."""


def write_bag(
    recording: Recording,
    path: Path,
    *,
    scans: Iterable[LaserScan] = (),
    attitudes: Iterable[AhrsReading] = (),
    storage: str = "sqlite3",
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a recording as a bag; reading it back gives the frames that `write_recording`'s layout gives.

    Parameters
    ----------
    recording : Recording
        Its worn views and truth are written where it has them.
    path : Path
        New folder.
    scans : iterable of LaserScan
        Of scanners; each goes to ``/NAME/scan``. The message holds ranges as float32.
    attitudes : iterable of AhrsReading
        Of both AHRSs; angular velocity and acceleration are marked as not given.
    storage : {"sqlite3", "mcap"}
    progress : callable, optional
        Called with (frames done, frames in all).

    Raises
    ------
    DataError
        If the folder exists or cannot be written, a stamp is negative, a camera's model has no name in ROS,
        or the extra ``ros`` is not installed.  The folder appears only when it is complete.
    """
    with needs("ros"):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    if path.exists():
        raise DataError(f"The folder {path} exists already; give another one for the bag.")
    for camera in (recording.camera, recording.worn_camera):
        _check_model(camera)
    store = get_typestore(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    # The bag's files are named after its folder: it is written under its own name, one folder further down.
    partial = path.with_name(f".{path.name}.partial")
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        with Writer(partial / path.name, version=Writer.VERSION_LATEST, storage_plugin=plugin) as writer:
            bag = _Bag(writer, store)
            for i in range(len(recording)):
                _write_frame(bag, recording, i)
                if progress is not None:
                    progress(i + 1, len(recording))
            for scan in scans:
                bag.scan(scan)
            for reading in attitudes:
                bag.attitude(reading)
        os.replace(partial / path.name, path)
    except OSError as error:
        raise DataError(f"The bag {path} cannot be written ({error}); choose another place.") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _write_frame(bag: _Bag, recording: Recording, i: int) -> None:
    frame = recording.frame(i)
    stamp = _stamp(frame.t)
    if i == 0:
        bag.camera("/cs", stamp, recording.camera, ROBOT)
        if recording.worn_camera is not None:
            bag.camera("/cf", stamp, recording.worn_camera, WORN)
    bag.image("/cs", stamp, frame.image, ROBOT)
    if frame.worn is not None:
        bag.image("/cf", stamp, frame.worn.image, WORN)
        bag.pose_with_covariance("/t_cf", stamp, frame.worn.t_cf, frame.worn.covariance)
    if recording.truth is not None and bool(np.isfinite(recording.truth[i]).all()):
        bag.pose("/truth", stamp, recording.truth[i])


def _check_model(camera: Camera | None) -> None:
    if camera is not None and camera.model not in _MODELS:
        raise DataError(
            f"The camera's model '{camera.model}' has no name in ROS; give a pinhole, radtan or fisheye one."
        )


class _Bag:
    """Writes messages; topics appear with their first one."""

    def __init__(self, writer: Any, store: Any) -> None:
        self._writer, self._store = writer, store
        self._connections: dict[str, Any] = {}

    def image(self, above: str, stamp: int, image: Image, frame: str) -> None:
        h, w = image.shape
        data = np.ascontiguousarray(image).ravel()
        header = self._header(stamp, frame)
        self._write(f"{above}/image_raw", "sensor_msgs/msg/Image", stamp, header, h, w, "mono8", 0, w, data)

    def camera(self, above: str, stamp: int, camera: Camera, frame: str) -> None:
        model, coefficients = _MODELS[camera.model]
        fx, fy, cx, cy = camera.intrinsics
        k = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        d = np.zeros(coefficients)
        d[: len(camera.distortion)] = camera.distortion
        p = np.concatenate([k.reshape(3, 3), np.zeros((3, 1))], axis=1).ravel()
        roi = self._make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        values = (camera.height, camera.width, model, d, k, np.eye(3).ravel(), p, 0, 0, roi)
        header = self._header(stamp, frame)
        self._write(f"{above}/camera_info", "sensor_msgs/msg/CameraInfo", stamp, header, *values)

    def pose(self, topic: str, stamp: int, pose: Array) -> None:
        self._write(
            topic, "geometry_msgs/msg/PoseStamped", stamp, self._header(stamp, WORLD), self._pose(pose)
        )

    def pose_with_covariance(self, topic: str, stamp: int, pose: Array, covariance: Array) -> None:
        fixed = tangent_to_fixed(pose, covariance).ravel()
        value = self._make("geometry_msgs/msg/PoseWithCovariance", self._pose(pose), fixed)
        kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
        self._write(topic, kind, stamp, self._header(stamp, ROBOT), value)

    def scan(self, scan: LaserScan) -> None:
        stamp, beams, topic = _stamp(scan.t), len(scan.ranges), SCAN_TOPIC.format(scan.scanner)
        angles = (scan.angle_min, scan.angle_min + (beams - 1) * scan.angle_increment, scan.angle_increment)
        times = (scan.time_increment, scan.time_increment * (beams - 1), scan.range_min, scan.range_max)
        ranges = np.asarray(scan.ranges, np.float32)
        self._write(
            topic, "sensor_msgs/msg/LaserScan", stamp, self._header(stamp, scan.scanner),
            *angles, *times, ranges, np.empty(0, np.float32),
        )  # fmt: skip

    def attitude(self, reading: AhrsReading) -> None:
        stamp = _stamp(reading.t)
        frame = "cs_ahrs" if reading.where == "robot" else "cf_ahrs"
        unknown, none = np.zeros(9), self._make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        unknown[0] = -1.0
        x, y, z, w = (float(v) for v in reading.q_xyzw)
        quaternion = self._make("geometry_msgs/msg/Quaternion", x, y, z, w)
        self._write(
            AHRS_TOPICS[reading.where], "sensor_msgs/msg/Imu", stamp, self._header(stamp, frame),
            quaternion, np.zeros(9), none, unknown, none, unknown,
        )  # fmt: skip

    def _pose(self, pose: Array) -> Any:
        w, x, y, z = stable_quaternion(pose[:3, :3])
        point = self._make("geometry_msgs/msg/Point", *(float(v) for v in pose[:3, 3]))
        turn = self._make("geometry_msgs/msg/Quaternion", x, y, z, w)
        return self._make("geometry_msgs/msg/Pose", point, turn)

    def _header(self, stamp: int, frame: str) -> Any:
        time = self._make("builtin_interfaces/msg/Time", *divmod(stamp, _NANOSECONDS))
        return self._make("std_msgs/msg/Header", time, frame)

    def _make(self, kind: str, *values: Any) -> Any:
        return self._store.types[kind](*values)

    def _write(self, topic: str, kind: str, stamp: int, *values: Any) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self._store)
        data = self._store.serialize_cdr(self._make(kind, *values), kind)
        self._writer.write(self._connections[topic], stamp, data)


def _stamp(t: float) -> int:
    stamp = round(float(t) * _NANOSECONDS)
    if stamp < 0:
        raise DataError(f"The stamp {t} s is negative; give stamps from zero on.")
    return stamp

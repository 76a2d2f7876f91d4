"""A recording of two cameras as a ROS 2 bag, with what its sensors read; needs the extra ``ros``.

Topics: ``/cs`` and ``/cf`` with ``image_raw`` and ``camera_info``, ``/t_cf`` (measured pose of Cf in Cs, with
covariance), ``/truth``; of several persons ``/cf/NAME`` and ``/t_cf/NAME``; and if there are readings
``/front/scan``, ``/back/scan``, ``/cs/imu``, ``/cf/imu``.  A gyroscope's samples are on ``/cs/gyro``, by the
clock of the frames, and how it sits is on ``/tf_static``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.ros.making import (
    CAMERA_INFO,
    IMAGE,
    NANOSECONDS,
    POSE_WITH_COVARIANCE,
    Maker,
    check_model,
)
from collabslam.errors import DataError
from collabslam.extras import needs
from collabslam.formats.partial_folder import PartialFolder
from collabslam.types import Array, Image, ImuLog, Recording, worn_cameras
from collabslam.worn_pose import AhrsReading, LaserScan
from collabslam.worn_pose.readings import Wearer

TOPICS = {"cs": "/cs/image_raw", "cf": "/cf/image_raw", "t_cf": "/t_cf", "truth": "/truth"}
"""Roles of the topics, as ``collabslam.open_recording(path, topics=...)`` takes them."""


def topics_of(persons: Iterable[str]) -> dict[str, str]:
    """The same where persons of these names wear a camera, with ``cf.NAME`` and ``t_cf.NAME`` of each."""
    names = [name for name in persons if name]
    own = {f"{role}.{name}": _of(TOPICS[role], name) for name in names for role in ("cf", "t_cf")}
    return own | {role: topic for role, topic in TOPICS.items() if not (names and role in ("cf", "t_cf"))}


def _of(topic: str, name: str) -> str:
    """A person's own topic in place of that of a single one."""
    first, *rest = topic.removeprefix("/").split("/")
    return "/" + "/".join([first, *([name] if name else []), *rest])


SCAN_TOPIC = "/{}/scan"
AHRS_TOPICS: dict[Wearer, str] = {"robot": "/cs/imu", "worn": "/cf/imu"}
GYRO_TOPIC, IMU = "/cs/gyro", "sensor_msgs/msg/Imu"
ROBOT, WORN, WORLD, GYRO = "cs_optical", "cf_optical", "world", "cs_gyro"


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
        Its worn views, gyroscope and truth are written where it has them.
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
    for camera in (recording.camera, *worn_cameras(recording).values()):
        check_model(camera)
    store = get_typestore(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    # The bag's files are named after its folder: it is written under its own name, one folder further down.
    folder = None
    try:
        folder = PartialFolder(path)
        with Writer(folder.path / path.name, version=Writer.VERSION_LATEST, storage_plugin=plugin) as writer:
            bag = _Bag(writer, store)
            log: ImuLog | None = getattr(recording, "imu", None)
            if log is not None:
                bag.gyroscope(log)
            for i in range(len(recording)):
                _write_frame(bag, recording, i)
                if progress is not None:
                    progress(i + 1, len(recording))
            for scan in scans:
                bag.scan(scan)
            for reading in attitudes:
                bag.attitude(reading)
        folder.take_place(path.name)
    except OSError as error:
        raise DataError(f"The bag {path} cannot be written ({error}); choose another place.") from error
    finally:
        if folder is not None:
            folder.discard()


def _write_frame(bag: _Bag, recording: Recording, i: int) -> None:
    frame = recording.frame(i)
    stamp = _stamp(frame.t)
    if i == 0:
        bag.camera("/cs", stamp, recording.camera, ROBOT)
        for name, camera in worn_cameras(recording).items():
            bag.camera(_of("/cf", name), stamp, camera, WORN)
    bag.image("/cs", stamp, frame.image, ROBOT)
    for view in frame.views:
        taken = stamp if view.t is None else _stamp(view.t)
        bag.image(_of("/cf", view.who), taken, view.image, WORN)
        bag.pose_with_covariance(_of("/t_cf", view.who), taken, view.t_cf, view.covariance)
    if recording.truth is not None and bool(np.isfinite(recording.truth[i]).all()):
        bag.pose("/truth", stamp, recording.truth[i])


class _Bag:
    """Writes messages; topics appear with their first one."""

    def __init__(self, writer: Any, store: Any) -> None:
        self._writer, self._store, self._maker = writer, store, Maker(store)
        self._connections: dict[str, Any] = {}

    def image(self, above: str, stamp: int, image: Image, frame: str) -> None:
        self._put(f"{above}/image_raw", IMAGE, stamp, self._maker.image(stamp, frame, image))

    def camera(self, above: str, stamp: int, camera: Camera, frame: str) -> None:
        self._put(f"{above}/camera_info", CAMERA_INFO, stamp, self._maker.camera_info(stamp, frame, camera))

    def pose(self, topic: str, stamp: int, pose: Array) -> None:
        values = (self._maker.header(stamp, WORLD), self._maker.pose(pose))
        self._write(topic, "geometry_msgs/msg/PoseStamped", stamp, *values)

    def pose_with_covariance(self, topic: str, stamp: int, pose: Array, covariance: Array) -> None:
        message = self._maker.pose_with_covariance(stamp, ROBOT, pose, covariance)
        self._put(topic, POSE_WITH_COVARIANCE, stamp, message)

    def scan(self, scan: LaserScan) -> None:
        stamp, beams, topic = _stamp(scan.t), len(scan.ranges), SCAN_TOPIC.format(scan.scanner)
        angles = (scan.angle_min, scan.angle_min + (beams - 1) * scan.angle_increment, scan.angle_increment)
        times = (scan.time_increment, scan.time_increment * (beams - 1), scan.range_min, scan.range_max)
        ranges = np.asarray(scan.ranges, np.float32)
        self._write(
            topic, "sensor_msgs/msg/LaserScan", stamp, self._maker.header(stamp, scan.scanner),
            *angles, *times, ranges, np.empty(0, np.float32),
        )  # fmt: skip

    def gyroscope(self, log: ImuLog) -> None:
        """All samples, and the mount, whose place in C nothing tells."""
        times = log.times + log.sensor.time_offset
        mount = np.eye(4)
        mount[:3, :3] = log.sensor.r_ci
        self._write(
            "/tf_static", "tf2_msgs/msg/TFMessage", _stamp(times[0]), [self._link(ROBOT, GYRO, mount)]
        )
        forces = np.full((len(log), 3), np.nan) if log.accelerations is None else log.accelerations
        for t, rate, force in zip(times.tolist(), log.rates, forces, strict=True):
            known = bool(np.isfinite(force).all())
            turns, pulls = (
                self._maker.make("geometry_msgs/msg/Vector3", *(float(x) for x in v))
                for v in (rate, force if known else np.zeros(3))
            )
            upright = self._maker.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
            self._write(
                GYRO_TOPIC, IMU, _stamp(t), self._maker.header(_stamp(t), GYRO), upright, _not_given(),
                turns, np.zeros(9), pulls, np.zeros(9) if known else _not_given(),
            )  # fmt: skip

    def _link(self, parent: str, child: str, pose: Array) -> Any:
        placed = self._maker.pose(pose)
        shift = self._maker.make("geometry_msgs/msg/Vector3", *(float(x) for x in pose[:3, 3]))
        moved = self._maker.make("geometry_msgs/msg/Transform", shift, placed.orientation)
        header = self._maker.header(0, parent)
        return self._maker.make("geometry_msgs/msg/TransformStamped", header, child, moved)

    def attitude(self, reading: AhrsReading) -> None:
        stamp = _stamp(reading.t)
        frame = "cs_ahrs" if reading.where == "robot" else "cf_ahrs"
        unknown, none = _not_given(), self._maker.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        x, y, z, w = (float(v) for v in reading.q_xyzw)
        quaternion = self._maker.make("geometry_msgs/msg/Quaternion", x, y, z, w)
        self._write(
            AHRS_TOPICS[reading.where], IMU, stamp, self._maker.header(stamp, frame),
            quaternion, np.zeros(9), none, unknown, none, unknown,
        )  # fmt: skip

    def _write(self, topic: str, kind: str, stamp: int, *values: Any) -> None:
        self._put(topic, kind, stamp, self._maker.make(kind, *values))

    def _put(self, topic: str, kind: str, stamp: int, message: Any) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self._store)
        self._writer.write(self._connections[topic], stamp, self._store.serialize_cdr(message, kind))


def _not_given() -> Array:
    """The covariance of what an Imu message does not have."""
    return np.asarray([-1.0, *np.zeros(8)])


def _stamp(t: float) -> int:
    stamp = round(float(t) * NANOSECONDS)
    if stamp < 0:
        raise DataError(f"The stamp {t} s is negative; give stamps from zero on.")
    return stamp

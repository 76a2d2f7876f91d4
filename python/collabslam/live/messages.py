"""What goes over the link and into the record: ROS 2 messages as CDR, made and read by rosbags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.ros import making
from collabslam.datasets.ros.messages import camera_of, pose_and_covariance_of
from collabslam.errors import CollabslamError, DataError
from collabslam.extras import needs
from collabslam.formats.ros_odometry import CAMERA, MAP, WORLD, odometry_message
from collabslam.live.clock import Exchange
from collabslam.live.monotonic_clock import nanoseconds, seconds
from collabslam.types import Array, Image
from collabslam.worn_pose import LaserScan

IMAGE, CAMERA_INFO, POSE = making.IMAGE, making.CAMERA_INFO, making.POSE_WITH_COVARIANCE
COMPRESSED = "sensor_msgs/msg/CompressedImage"
ODOMETRY = "nav_msgs/msg/Odometry"
CLOUD = "sensor_msgs/msg/PointCloud2"
STATUS = "diagnostic_msgs/msg/DiagnosticArray"
TIMES = "std_msgs/msg/Int64MultiArray"
NUMBERS = "std_msgs/msg/Float64MultiArray"
TEXT = "std_msgs/msg/String"
TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
SCAN, IMU = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/Imu"
GYRO = "cs_gyro"
"""The frame of the rates that a record keeps."""

MOST_TOLD, MOST_ASPECT = 1 << 23, 8.0
"""Pixels of a calibration that a device tells (4k is less), and how many times one side is the other."""
FARTHEST = 2.0**31
"""Seconds before which stamps are."""
_CLOUD_FIELDS = ("x", "y", "z", "sd")
LEVELS = {
    "OK": b"\0",
    "DEGRADED": b"\1",
    "COASTING": b"\1",
    "NOT_STARTED": b"\1",
    "LOST": b"\2",
    "STALE": b"\3",
}


@cache
def store() -> Any:
    """The types of ROS 2, as rosbags has them."""
    with needs("ros"):
        from rosbags.typesys import Stores, get_typestore
    return get_typestore(Stores.ROS2_HUMBLE)


def encoded(kind: str, message: Any) -> bytes:
    """A message as CDR."""
    return bytes(store().serialize_cdr(message, kind))


def decoded(kind: str, data: bytes) -> Any:
    """The message of a type in CDR; raises DataError for anything else, whatever it is."""
    try:
        return store().deserialize_cdr(data, kind)
    except CollabslamError:
        raise
    except Exception as error:  # rosbags raises many kinds for broken data
        raise DataError(f"The message is no {kind} ({type(error).__name__}); send CDR of ROS 2.") from error


@cache
def maker() -> making.Maker:
    """Makes messages of these types."""
    return making.Maker(store())


def make(kind: str, *values: Any) -> Any:
    """A message of its fields' values."""
    return maker().make(kind, *values)


def header(t: float, frame: str) -> Any:
    """A header: ``t`` seconds; raises DataError, as all that make messages do, if they cannot be told."""
    return maker().header(_stamp(t), frame)


def _stamp(t: float) -> int:
    """Nanoseconds; DataError from 2038 on, as messages count seconds in 32 bits."""
    if not -FARTHEST < t < FARTHEST:
        raise DataError(f"The time {t} s is in no message; give seconds since 1970, or since a start.")
    return nanoseconds(t)


def stamp_of(message: Any) -> float:
    """Seconds of a message's header."""
    stamp = message.header.stamp
    return seconds(int(stamp.sec) * 10**9 + int(stamp.nanosec))


def compressed_image(t: float, frame: str, data: bytes) -> bytes:
    """A JPEG or PNG as CompressedImage."""
    form = "png" if data.startswith(b"\x89PNG") else "jpeg"
    return encoded(COMPRESSED, make(COMPRESSED, header(t, frame), form, np.frombuffer(data, np.uint8)))


def raw_image(t: float, frame: str, image: Image) -> bytes:
    """A (H, W) uint8 grey image as Image."""
    return encoded(IMAGE, maker().image(_stamp(t), frame, image))


def camera_info(t: float, frame: str, camera: Camera) -> bytes:
    """A calibration as CameraInfo; raises DataError for a model that has no name in ROS."""
    return encoded(CAMERA_INFO, maker().camera_info(_stamp(t), frame, camera))


def camera_from(data: bytes, where: str, topic: str = "") -> Camera:
    """The calibration of a CameraInfo for the images of a topic; raises DataError."""
    return camera_of(decoded(CAMERA_INFO, data), where, topic)


def told_camera(data: bytes, device: str) -> Camera:
    """The calibration that a device tells of itself: what its pictures then cost is bounded by it.

    Raises
    ------
    DataError
        If it is none, or of a larger picture than a device sends.
    """
    camera = camera_from(data, f"the device {device}")
    long, short = max(camera.width, camera.height), min(camera.width, camera.height)
    if long * short > MOST_TOLD or long > MOST_ASPECT * short:
        raise DataError(
            f"The device {device} tells a calibration of {camera.width} x {camera.height} pixels; give it "
            "with --worn-camera FILE."
        )
    return camera


def pose(t: float, frame: str, matrix: Array, covariance: Array) -> bytes:
    """A pose (4, 4) with covariance (6, 6), tangent on the right, as PoseWithCovarianceStamped.

    The message's covariance is along the fixed axes of ``frame``, as ROS has it.
    """
    return encoded(POSE, maker().pose_with_covariance(_stamp(t), frame, matrix, covariance))


def pose_from(data: bytes, where: str) -> tuple[float, Array, Array]:
    """Stamp, pose (4, 4) and covariance (6, 6), tangent on the right; raises DataError."""
    message = decoded(POSE, data)
    return stamp_of(message), *pose_and_covariance_of(message, where)


def odometry(
    t: float,
    t_wc: Array,
    covariance: Array,
    twist: tuple[Array, Array] | None = None,
    frames: tuple[str, str] = (WORLD, CAMERA),
) -> bytes:
    """A pose, and a twist with its covariance, as Odometry; see `collabslam.formats.ros_odometry`."""
    return encoded(ODOMETRY, odometry_message(store().types, _stamp(t), t_wc, covariance, twist, frames))


def rate(t: float, value: Array, acceleration: Array | None = None, frame: str = GYRO) -> bytes:
    """A gyroscope's rate (3,), rad/s, and maybe an acceleration (3,), m/s^2, as an Imu without attitude."""
    unknown, zero = np.array([-1.0, *np.zeros(8)]), np.zeros(9)
    force, spread = (zero[:3], unknown) if acceleration is None else (acceleration, zero)
    turned, pulled = (make("geometry_msgs/msg/Vector3", *map(float, v)) for v in (value, force))
    upright = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
    return encoded(IMU, make(IMU, header(t, frame), upright, unknown, turned, zero, pulled, spread))


def rate_of(message: Any) -> Array:
    """The rate (3,) of an Imu message, rad/s; raises DataError if it says that it has none."""
    if message.angular_velocity_covariance[0] == -1.0:
        raise DataError("An Imu message has no angular velocity (its covariance begins with -1).")
    w = message.angular_velocity
    return np.array([w.x, w.y, w.z])


def acceleration_of(message: Any) -> Array | None:
    """The acceleration (3,) of an Imu message, m/s^2; None if it says that it has none, or is not finite."""
    a = message.linear_acceleration
    found = np.array([a.x, a.y, a.z])
    is_there = message.linear_acceleration_covariance[0] != -1.0 and bool(np.isfinite(found).all())
    return found if is_there else None


def twist(t: float, value: Array, covariance: Array, frame: str = "base_link") -> bytes:
    """A twist (6,) with covariance (6, 6) along a frame's axes as TwistWithCovarianceStamped."""
    halves = [make("geometry_msgs/msg/Vector3", *map(float, half)) for half in (value[:3], value[3:])]
    inner = make("geometry_msgs/msg/Twist", *halves)
    whole = make("geometry_msgs/msg/TwistWithCovariance", inner, covariance.ravel())
    return encoded(TWIST, make(TWIST, header(t, frame), whole))


def robot_pose(t: float, t_wc: Array, covariance: Array) -> bytes:
    """The robot's pose as PoseWithCovarianceStamped."""
    return pose(t, WORLD, t_wc, covariance)


def pose_in_map(t: float, pose_map: Array, covariance: Array) -> bytes:
    """The robot's pose as loops correct it, as PoseWithCovarianceStamped."""
    return pose(t, MAP, pose_map, covariance)


def exchange(session: str, found: Exchange) -> bytes:
    """Four stamps as Int64MultiArray: sent, received, answered, returned, nanoseconds."""
    return times(session, [found.sent, found.received, found.answered, found.returned])


def times(label: str, stamps: Sequence[float]) -> bytes:
    """Stamps (seconds) as whole nanoseconds with a label."""
    values = np.array([nanoseconds(t) for t in stamps], np.int64)
    dimension = make("std_msgs/msg/MultiArrayDimension", label, len(values), len(values))
    layout = make("std_msgs/msg/MultiArrayLayout", [dimension], 0)
    return encoded(TIMES, make(TIMES, layout, values))


def times_from(data: bytes, count: int) -> tuple[str, list[float]]:
    """Label and stamps (seconds) of `times`; raises DataError if they are not so many."""
    return times_of(decoded(TIMES, data), count)


def times_of(message: Any, count: int) -> tuple[str, list[float]]:
    """The same of the message itself."""
    if len(message.layout.dim) != 1 or len(message.data) != count:
        raise DataError(f"The message has {len(message.data)} stamps; send {count} with one label.")
    return str(message.layout.dim[0].label), [seconds(int(v)) for v in message.data]


def exchange_from(data: bytes) -> tuple[str, Exchange]:
    """Session and exchange of an `exchange`; raises DataError."""
    return exchange_of(decoded(TIMES, data))


def exchange_of(message: Any) -> tuple[str, Exchange]:
    """The same of the message itself."""
    session, stamps = times_of(message, 4)
    return session, Exchange(*stamps)


def numbers(values: Array) -> bytes:
    """An array as Float64MultiArray, row by row."""
    layout = make("std_msgs/msg/MultiArrayLayout", [], 0)
    return encoded(NUMBERS, make(NUMBERS, layout, np.ascontiguousarray(values, np.float64).ravel()))


def attitude(t: float, frame: str, q_xyzw: Array) -> bytes:
    """An attitude, x y z w, as an Imu without rates and accelerations."""
    zero = make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
    turn = make("geometry_msgs/msg/Quaternion", *map(float, q_xyzw))
    unknown, none = np.zeros(9), np.array([-1.0, *[0.0] * 8])
    return encoded(IMU, make(IMU, header(t, frame), turn, unknown, zero, none, zero, none))


def scan(t: float, frame: str, found: LaserScan) -> bytes:
    """A scan whose first beam is of ``t`` seconds as LaserScan."""
    first, step, count = found.angle_min, found.angle_increment, len(found.ranges)
    limits = (found.range_min, found.range_max)
    ranges, none = np.asarray(found.ranges, np.float32), np.zeros(0, np.float32)
    angles = (first, first + (count - 1) * step, step, found.time_increment, 0.0)
    return encoded(SCAN, make(SCAN, header(t, frame), *angles, *limits, ranges, none))


def status(t: float, entries: Mapping[str, tuple[str, str, Mapping[str, Any]]]) -> bytes:
    """DiagnosticArray: by name, a status, a message and values."""
    rows = []
    for name, (state, text, values) in entries.items():
        pairs = [make("diagnostic_msgs/msg/KeyValue", str(k), str(v)) for k, v in values.items()]
        level = LEVELS.get(state, b"\0")
        rows.append(
            make(
                "diagnostic_msgs/msg/DiagnosticStatus", int.from_bytes(level, "little"), name, text, "", pairs
            )
        )
    return encoded(STATUS, make(STATUS, header(t, WORLD), rows))


def status_from(data: bytes) -> dict[str, dict[str, str]]:
    """Values of each status by its name, with its message as ``message``; raises DataError."""
    rows = decoded(STATUS, data).status
    return {
        str(r.name): {"message": str(r.message)} | {str(v.key): str(v.value) for v in r.values} for r in rows
    }


def transforms(t: float, *links: tuple[str, str, Array]) -> bytes:
    """TFMessage of links: parent, child, and the child's pose (4, 4) in the parent."""
    return encoded(TRANSFORMS, make(TRANSFORMS, [_link(t, *link) for link in links]))


def _link(t: float, parent: str, child: str, t_parent_child: Array) -> Any:
    pose = maker().pose(t_parent_child)
    place = make("geometry_msgs/msg/Vector3", pose.position.x, pose.position.y, pose.position.z)
    whole = make("geometry_msgs/msg/Transform", place, pose.orientation)
    return make("geometry_msgs/msg/TransformStamped", header(t, parent), child, whole)


def cloud(t: float, points: Array, sd: Array, frame: str = WORLD) -> bytes:
    """Points (N, 3), metres in a frame, as PointCloud2 of float32 x, y, z, and ``sd`` (N,), metres."""
    rows = np.column_stack([points, sd]).reshape(-1, len(_CLOUD_FIELDS))
    data = np.ascontiguousarray(rows, "<f4").view(np.uint8).ravel()
    fields = [make("sensor_msgs/msg/PointField", name, 4 * k, 7, 1) for k, name in enumerate(_CLOUD_FIELDS)]
    count, step = len(rows), 4 * len(_CLOUD_FIELDS)
    message = make(CLOUD, header(t, frame), 1, count, fields, False, step, step * count, data, True)
    return encoded(CLOUD, message)


def cloud_from(data: bytes) -> tuple[Array, Array]:
    """Points (N, 3) and standard deviations (N,) of a `cloud`; raises DataError."""
    message, step = decoded(CLOUD, data), 4 * len(_CLOUD_FIELDS)
    if message.point_step != step or len(message.data) % step:
        raise DataError(f"The cloud has other fields than {', '.join(_CLOUD_FIELDS)}; send float32 of these.")
    rows = np.frombuffer(bytes(message.data), "<f4").reshape(-1, len(_CLOUD_FIELDS)).astype(np.float64)
    return rows[:, :3], rows[:, 3]


def point_sd(covariance: Array) -> Array:
    """The standard deviation (N,) of points along the direction in which each is known least, metres."""
    if not len(covariance):
        return np.empty(0)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0)))


def text(value: str) -> bytes:
    """A text as String."""
    return encoded(TEXT, make(TEXT, value))

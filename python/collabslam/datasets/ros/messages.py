"""ROS messages, of ROS 1 and ROS 2 alike, as arrays."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.datasets.calibration import camera_from_mapping
from collabslam.datasets.images import decode, shallow
from collabslam.errors import DataError
from collabslam.geometry import fixed_to_tangent, pose_from_quaternion, rounded_covariance
from collabslam.types import Array, Image

_CHANNELS = {
    "mono8": (1, None),
    "8uc1": (1, None),
    "bgr8": (3, cv2.COLOR_BGR2GRAY),
    "8uc3": (3, cv2.COLOR_BGR2GRAY),
    "rgb8": (3, cv2.COLOR_RGB2GRAY),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY),
    "rgba8": (4, cv2.COLOR_RGBA2GRAY),
    # OpenCV names a Bayer pattern by its second row and column.
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2GRAY),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2GRAY),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2GRAY),
}
_DEEP = ("mono16", "16uc1")
FARTHEST = 1e3
"""Limit of scanners that state none, metres."""


@dataclass(frozen=True)
class Scans:
    """Laser scans of one topic.

    Attributes
    ----------
    times : (N,) seconds
    angles : (K,) radians, of each beam
    ranges : (N, K) metres; infinite where a beam met nothing up to ``range_max``, NaN where it tells nothing
    frame : str
        The sensor's frame.
    time_increment : float
        Seconds from beam to beam.
    range_max : float
        The sensor's limit, metres.
    """

    times: Array
    angles: Array
    ranges: Array
    frame: str
    time_increment: float = 0.0
    range_max: float = FARTHEST


@dataclass(frozen=True)
class ImuSamples:
    """Inertial samples of one topic, in the sensor's own axes.

    Attributes
    ----------
    times : (N,) seconds
    orientation : (N, 4) quaternion w x y z of the sensor in its fixed frame; NaN where it is not given
    angular_velocity : (N, 3) rad/s
    acceleration : (N, 3) m/s^2
    frame : str
    """

    times: Array
    orientation: Array
    angular_velocity: Array
    acceleration: Array
    frame: str


def stamp_seconds(message: Any, received: int) -> float:
    """The header's stamp; the time of recording (ns) where it is zero or missing."""
    header = getattr(message, "header", None)
    if header is None or (header.stamp.sec == 0 and header.stamp.nanosec == 0):
        return received / 10**9
    return (int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)) / 10**9


def deepest(message: Any) -> int:
    """The largest value of a picture of more than 8 bits a pixel; 0 of any other."""
    if str(getattr(message, "encoding", "")).lower() not in _DEEP:
        return 0
    data = np.asarray(message.data, dtype=np.uint8).ravel()
    samples = data[: data.size // 2 * 2].view(">u2" if message.is_bigendian else "<u2")
    return int(samples.max(initial=0))


def depth_of(message: Any, where: str) -> Array:
    """(H, W) metres of a depth image: 16UC1 (millimetres) or 32FC1 (metres), 0 or NaN where there is none.

    Raises
    ------
    DataError
        If the encoding is another one, or the data is cut short.
    """
    encoding = str(getattr(message, "encoding", "compressed")).upper()
    if encoding not in ("16UC1", "MONO16", "32FC1"):
        raise DataError(f"The depth image {where} is '{encoding}'; record the raw depth, 16UC1 or 32FC1.")
    size, kind, unit = (4, "f4", 1.0) if encoding == "32FC1" else (2, "u2", 1e-3)
    height, width = int(message.height), int(message.width)
    step = int(message.step) or width * size
    data = np.asarray(message.data, dtype=np.uint8).ravel()
    if width * size > step or data.size < height * step or height * width == 0:
        raise DataError(f"The depth image {where} has {data.size} bytes for {width}x{height}; it is broken.")
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, : width * size])
    return np.asarray(rows.view((">" if message.is_bigendian else "<") + kind) * unit, dtype=np.float64)


def image_of(message: Any, where: str, bits: int = 16) -> Image:
    """(H, W) uint8 grey image of an Image or CompressedImage.

    Parameters
    ----------
    message
    where : str
        What to call it in an error.
    bits : int
        That a picture of more than 8 bits a pixel uses.

    Raises
    ------
    DataError
        If the encoding is not supported, or the data is cut short or broken.
    """
    data = np.asarray(message.data, dtype=np.uint8).ravel()
    if not hasattr(message, "encoding"):
        return decode(data.tobytes(), where)
    encoding, height, width = str(message.encoding).lower(), int(message.height), int(message.width)
    deep = encoding in _DEEP
    if not deep and encoding not in _CHANNELS:
        known = ", ".join([*_CHANNELS, *_DEEP])
        raise DataError(f"The image {where} has the encoding '{message.encoding}'; supported are {known}.")
    channels, conversion = (2, None) if deep else _CHANNELS[encoding]
    step = int(message.step) or width * channels
    if width * channels > step or data.size < height * step or height * width == 0:
        raise DataError(
            f"The image {where} has {data.size} bytes for {width}x{height} {encoding}; it is broken."
        )
    rows = data[: height * step].reshape(height, step)[:, : width * channels]
    if deep:
        order = ">u2" if message.is_bigendian else "<u2"
        return shallow(np.ascontiguousarray(rows).view(order).astype(np.uint16), bits, where)
    if conversion is None:
        return np.ascontiguousarray(rows)
    pixels = np.ascontiguousarray(rows.reshape(height, width, channels) if channels > 1 else rows)
    return np.asarray(cv2.cvtColor(pixels, conversion), dtype=np.uint8)


def camera_of(message: Any, where: str) -> Camera:
    """Camera of a CameraInfo.

    Raises
    ------
    DataError
        If the camera is not calibrated, binned or cropped, or its model is not supported.
    """
    k = np.asarray(getattr(message, "k", getattr(message, "K", [])), dtype=np.float64)
    d = np.asarray(getattr(message, "d", getattr(message, "D", [])), dtype=np.float64)
    if k.size != 9 or k[0] == 0.0:
        raise DataError(
            f"The CameraInfo of {where} is not calibrated (K is zero); give --camera FILE ('collabslam "
            "init --board' makes one)."
        )
    if max(message.binning_x, message.binning_y) > 1 or (message.roi.width or message.roi.x_offset):
        raise DataError(
            f"The CameraInfo of {where} is for binned or cropped images; give --camera FILE for these images."
        )
    model = str(message.distortion_model) or "none"
    if model == "rational_polynomial" and not np.any(d[5:]):
        model, d = "plumb_bob", d[:5]
    content = {
        "camera_matrix": {"data": k},
        "distortion_model": model,
        "distortion_coefficients": {"data": d if np.any(d) or model != "plumb_bob" else []},
        "image_width": message.width,
        "image_height": message.height,
    }
    return camera_from_mapping(content, f"CameraInfo of {where}")


def pose_of(pose: Any, where: str) -> Array:
    """4x4 of a Pose or a Transform."""
    t = getattr(pose, "position", None) or pose.translation
    q = getattr(pose, "orientation", None) or pose.rotation
    try:
        return pose_from_quaternion([t.x, t.y, t.z], [q.w, q.x, q.y, q.z])
    except ValueError as error:
        raise DataError(f"The pose of {where} is not usable: {error}") from error


def pose_and_covariance_of(message: Any, where: str) -> tuple[Array, Array]:
    """4x4 pose of a PoseWithCovarianceStamped (or Odometry), and its covariance on the right tangent.

    The message's covariance is over (x, y, z, rotation about X, Y, Z) along fixed axes.
    """
    pose = pose_of(message.pose.pose, where)
    covariance = np.asarray(message.pose.covariance, dtype=np.float64).reshape(6, 6)
    if not np.isfinite(covariance).all() or np.linalg.eigvalsh(0.5 * (covariance + covariance.T))[0] <= 0.0:
        raise DataError(
            f"The covariance of {where} is not positive definite; fill it in where the pose is measured."
        )
    return pose, rounded_covariance(fixed_to_tangent(pose, 0.5 * (covariance + covariance.T)))


def twist_of(message: Any) -> tuple[Array, Array]:
    """Twist (6,) of a TwistStamped, with or without covariance, or an Odometry, and its covariance (6, 6).

    Zeros where it has none.
    """
    inner = message.twist
    covariance = np.zeros((6, 6))
    if hasattr(inner, "covariance"):
        covariance = np.asarray(inner.covariance, np.float64).reshape(6, 6)
        inner = inner.twist
    v, w = inner.linear, inner.angular
    return np.array([v.x, v.y, v.z, w.x, w.y, w.z]), covariance


def scans_of(messages: Iterable[tuple[float, Any]]) -> Scans:
    """Laser scans of LaserScan messages with their stamps."""
    times: list[float] = []
    ranges: list[Array] = []
    first = None
    for t, message in messages:
        first = message if first is None else first
        row = np.asarray(message.ranges, dtype=np.float64).copy()
        row[~(row >= message.range_min)] = np.nan
        row[row > message.range_max] = np.inf
        if ranges and len(row) != len(ranges[0]):
            raise DataError(f"The scan at {t:.3f} s has {len(row)} beams, the first one {len(ranges[0])}.")
        times.append(t)
        ranges.append(row)
    if first is None:
        return Scans(np.empty(0), np.empty(0), np.empty((0, 0)), "")
    angles = first.angle_min + first.angle_increment * np.arange(len(ranges[0]))
    frame = str(first.header.frame_id)
    limit = min(float(first.range_max), FARTHEST)
    return Scans(np.asarray(times), angles, np.asarray(ranges), frame, float(first.time_increment), limit)


def imu_of(messages: Iterable[tuple[float, Any]]) -> ImuSamples:
    """Inertial samples of Imu messages with their stamps."""
    rows, frame = [], ""
    for t, m in messages:
        q, w, a = m.orientation, m.angular_velocity, m.linear_acceleration
        known = m.orientation_covariance[0] >= 0.0 and abs(q.w) + abs(q.x) + abs(q.y) + abs(q.z) > 0.0
        attitude = (q.w, q.x, q.y, q.z) if known else (np.nan,) * 4
        rows.append((t, *attitude, w.x, w.y, w.z, a.x, a.y, a.z))
        frame = str(m.header.frame_id)
    table = np.asarray(rows, dtype=np.float64).reshape(-1, 11)
    return ImuSamples(table[:, 0], table[:, 1:5], table[:, 5:8], table[:, 8:], frame)

"""ROS messages, of ROS 1 and ROS 2 alike, as arrays."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.datasets.calibration import of_keys
from collabslam.datasets.deep_range import Extent, Range, extent_of
from collabslam.datasets.gate import Keys
from collabslam.datasets.images import decode, deep, extent, one_channel
from collabslam.datasets.lens import model_of
from collabslam.errors import DataError
from collabslam.geometry import fixed_to_tangent, pose_from_quaternion, rounded_covariance
from collabslam.types import Array, Image

_MOSAICS = {
    # OpenCV names a Bayer pattern by its second row and column.
    "bayer_rggb": cv2.COLOR_BayerBG2GRAY,
    "bayer_bggr": cv2.COLOR_BayerRG2GRAY,
    "bayer_gbrg": cv2.COLOR_BayerGR2GRAY,
    "bayer_grbg": cv2.COLOR_BayerGB2GRAY,
}
_COLOURS = {
    "bgr": (3, cv2.COLOR_BGR2GRAY),
    "rgb": (3, cv2.COLOR_RGB2GRAY),
    "bgra": (4, cv2.COLOR_BGRA2GRAY),
    "rgba": (4, cv2.COLOR_RGBA2GRAY),
}
_ENCODINGS: dict[str, tuple[int, str, int | None]] = {
    **dict.fromkeys(("mono8", "8uc1", "nv12", "nv21", "nv24"), (1, "u1", None)),
    **dict.fromkeys(("mono16", "16uc1"), (1, "u2", None)),
    **dict.fromkeys(("yuv422", "uyvy"), (2, "u1", cv2.COLOR_YUV2GRAY_UYVY)),
    **dict.fromkeys(("yuv422_yuy2", "yuyv", "yuy2"), (2, "u1", cv2.COLOR_YUV2GRAY_YUY2)),
}
for _bits, _kind in (("8", "u1"), ("16", "u2")):
    _ENCODINGS |= {name + _bits: (channels, _kind, code) for name, (channels, code) in _COLOURS.items()}
    _ENCODINGS |= {name + _bits: (1, _kind, code) for name, code in _MOSAICS.items()}
    _ENCODINGS |= {f"{_bits}uc{n}": _ENCODINGS[name + _bits] for n, name in ((3, "bgr"), (4, "bgra"))}
"""Channels, type of a sample and OpenCV's conversion to grey; nv12 begins with the rows of Y."""
_FILM = re.compile(r"h\.?26[45]|hevc|av1|vp[89]|theora|ffmpeg", re.IGNORECASE)
"""Formats of a CompressedImage that need what came before."""
_GREY = ("mono8", "8uc1", "mono16", "16uc1")
_ALL_BITS = Range(0, 16)
_ROUGHER = 2.0
"""Times by which pictures are rougher in the wrong order of their bytes."""
MOST_METRES = 200.0
"""Of a depth image in metres: more are millimetres."""
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


def is_compressed(message: Any) -> bool:
    """Whether a message is a CompressedImage."""
    return not hasattr(message, "encoding")


def extent_in(message: Any) -> Extent:
    """The extent of a picture of more than 8 bits; its largest value is 0 of any other."""
    if is_compressed(message):
        return extent(np.asarray(message.data, dtype=np.uint8).tobytes())
    _, kind, _ = _ENCODINGS.get(str(message.encoding).lower(), (0, "u1", None))
    if kind == "u1":
        return Extent(0, 0, 0)
    data = np.asarray(message.data, dtype=np.uint8).ravel()
    return extent_of(_in_order(data[: data.size // 2 * 2].view(">u2" if message.is_bigendian else "<u2")))


def said_to_be_grey(message: Any, where: str) -> np.ndarray | None:
    """The samples (H, W) of a picture that is said to be grey; None of any other, or a broken one."""
    encoding = str(message.format if is_compressed(message) else message.encoding).lower()
    if is_compressed(message):
        known = encoding.startswith("bayer") or "compresseddepth" in encoding
        return None if known else one_channel(np.asarray(message.data, dtype=np.uint8).tobytes())
    if encoding not in _GREY:
        return None
    with suppress(DataError):
        return np.asarray(_samples(message, 1, _ENCODINGS[encoding][1], where))
    return None


def _in_order(samples: np.ndarray) -> np.ndarray:
    """Samples of 16 bits in the order of bytes that they have: some drivers state the other one.

    In the wrong one neighbours differ as any two samples do.
    """
    other = samples.byteswap()
    rough, smooth = (_roughness(words[: 1 << 16]) for words in (samples.ravel(), other.ravel()))
    return other if rough > _ROUGHER * smooth else samples


def _roughness(samples: np.ndarray) -> float:
    """How far neighbours differ, as a share of how far any two samples do."""
    values = samples.astype(np.float64)
    spread = float(np.abs(values - np.median(values)).mean())
    return float(np.abs(np.diff(values)).mean()) / spread if spread > 0.0 else 0.0


def depth_of(message: Any, where: str, per_metre: float) -> Array:
    """(H, W) metres of a depth image, 0 or NaN where there is none: 16UC1 or 32FC1, raw or compressed as PNG.

    Parameters
    ----------
    message
    where : str
        What to call it in an error.
    per_metre : float
        Counts at one metre of 16UC1; 32FC1 is in metres.

    Raises
    ------
    DataError
        If the encoding is another one, or the data is cut short.
    """
    if is_compressed(message):
        return _compressed_depth(message, where, per_metre)
    encoding = str(message.encoding).upper()
    if encoding not in ("16UC1", "MONO16", "32FC1"):
        raise DataError(f"The depth image {where} is '{encoding}'; record the depth as 16UC1 or 32FC1.")
    kind, unit = ("f4", 1.0) if encoding == "32FC1" else ("u2", per_metre)
    metres = np.asarray(_samples(message, 1, kind, where) / unit, dtype=np.float64)
    known = metres[np.isfinite(metres) & (metres > 0.0)]
    if kind == "f4" and known.size and float(np.median(known)) > MOST_METRES:
        raise DataError(
            f"The depth image {where} has {float(np.median(known)):.0f} m in its middle; 32FC1 is metres: "
            "divide it by 1000 if it counts millimetres."
        )
    return metres


def _compressed_depth(message: Any, where: str, per_metre: float) -> Array:
    """Of the transports ``compressed`` and ``compressedDepth``, whose PNG follows twelve bytes."""
    data, form = np.asarray(message.data, dtype=np.uint8).tobytes(), str(message.format)
    head = data[:12] if "compressedDepth" in form else b""
    counts = deep(data[len(head) :], where)
    if not form.upper().startswith("32FC1"):
        return np.asarray(counts / per_metre, dtype=np.float64)
    if len(head) < 12:
        raise DataError(f"The depth image {where} is '{form}'; record it by compressedDepth, or raw.")
    slope, offset = np.frombuffer(head[4:], "<f4").astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(counts > 0, slope / (counts - offset), np.nan)


def image_of(message: Any, where: str, used: Range | None = None, mosaic: int | None = None) -> Image:
    """(H, W) uint8 grey image of an Image or CompressedImage.

    Parameters
    ----------
    message
    where : str
        What to call it in an error.
    used : Range, optional
        Of the values of a picture of more than 8 bits.
    mosaic : int, optional
        OpenCV's conversion of a Bayer pattern to grey, if a picture that is said to be grey is one.

    Raises
    ------
    DataError
        If the encoding is not supported, or the data is cut short or broken.
    """
    if is_compressed(message):
        pattern = str(message.format).lower().split(";")[0].strip().rstrip("168")
        data = np.asarray(message.data, dtype=np.uint8).tobytes()
        if film := _FILM.search(str(message.format)):
            raise DataError(
                f"The image {where} is a part of a film ({film[0]}), not a picture; record it as jpeg or png."
            )
        return decode(data, where, deep=used, mosaic=_MOSAICS.get(pattern, mosaic))
    encoding = str(message.encoding).lower()
    if encoding not in _ENCODINGS:
        known = ", ".join(_ENCODINGS)
        raise DataError(f"The image {where} has the encoding '{message.encoding}'; supported are {known}.")
    channels, kind, conversion = _ENCODINGS[encoding]
    pixels = _samples(message, channels, kind, where)
    pixels = _in_order(pixels) if kind == "u2" else pixels
    conversion = mosaic if encoding in _GREY else conversion
    grey = pixels if conversion is None else cv2.cvtColor(pixels, conversion)
    return (used or _ALL_BITS).grey(np.ascontiguousarray(grey))


def _samples(message: Any, channels: int, kind: str, where: str) -> Any:
    """(H, W) or (H, W, channels) of an Image's data, in this machine's order of bytes."""
    size, height, width = channels * int(kind[1]), int(message.height), int(message.width)
    data = np.asarray(message.data, dtype=np.uint8).ravel()
    step = int(message.step) or width * size
    if width * size > step or data.size < height * step or height * width == 0:
        raise DataError(
            f"The image {where} has {data.size} bytes for {width}x{height} {message.encoding}; it is broken."
        )
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, : width * size])
    samples = rows.view((">" if message.is_bigendian else "<") + kind)
    samples = samples.astype(samples.dtype.newbyteorder("="), copy=False)
    return samples.reshape(height, width, channels) if channels > 1 else samples


def lens_numbers(message: Any) -> Array:
    """K, P and distortion of a CameraInfo, one after the other."""
    parts = [getattr(message, name, getattr(message, name.upper(), ())) for name in "kpd"]
    return np.concatenate([np.asarray(part, dtype=np.float64).ravel() for part in parts])


def camera_of(message: Any, where: str, topic: str = "") -> Camera:
    """Camera of a CameraInfo.

    Parameters
    ----------
    message
    where : str
        What to call it in an error.
    topic : str
        Of the images: rectified ones have the lens P, without distortion.

    Raises
    ------
    DataError
        If the camera is not calibrated, binned or cropped, or its model is not supported.
    """
    lens: dict[str, Any] = {
        name: getattr(message, name, getattr(message, name.upper(), None)) for name in "dkrp"
    }
    if np.size(lens["k"]) != 9 or lens["k"][0] == 0.0:
        raise DataError(
            f"The CameraInfo of {where} is not calibrated (K is zero); give --camera FILE ('collabslam "
            "init --board' makes one)."
        )
    model = str(message.distortion_model)
    if len(lens["d"]) and not np.any(lens["d"]) and model_of(model) == "radtan":
        model = "none"
    content = lens | {
        "distortion_model": model,
        "roi": {name: getattr(message.roi, name) for name in ("x_offset", "y_offset", "width", "height")},
        **{name: getattr(message, name) for name in ("width", "height", "binning_x", "binning_y")},
    }
    with Keys(content, f"CameraInfo of {where}") as keys:
        return of_keys(keys, topic).camera


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

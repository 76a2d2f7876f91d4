"""Camera calibrations of every kind that people have, and what stands beside the lens in them.

What programs write as keys is read by `collabslam.datasets.lens_programs`, what has no keys by
`collabslam.datasets.lens_lines`; all becomes one `collabslam._core.Camera`, see `collabslam.datasets.lens`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.gate import Keys, has_keys, read_keys, tell
from collabslam.datasets.lens import lens, of_matrix
from collabslam.datasets.lens_lines import camera_of_lines
from collabslam.datasets.lens_programs import camera_of_keys
from collabslam.datasets.poses import rigid
from collabslam.errors import DataError
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Image

_RATE = ("rate", "Camera.fps", "fps")
_DEPTH_SCALE = ("depth_scale", "DepthMapFactor", "RGBD.DepthMapFactor")
_DISTORTION_NAMES = {
    "pinhole": "none",
    "radtan": "radial-tangential",
    "fisheye": "equidistant",
    "wideangle": "wideangle",
}


@dataclass(frozen=True)
class Calibration:
    """What a calibration file says.

    Attributes
    ----------
    camera : Camera
    rate : float or None
        Images a second.
    depth_scale : float or None
        Counts of a depth image at one metre.
    t_bs : (4, 4) float64 or None
        Maps points of the sensor into the body, metres.
    mask : Path or None
        Image of what is never scene in the camera's own; see `collabslam.datasets.masks`.
    body : bool
        Of a worn camera, whether somebody wears it; see `collabslam.types.WornView`.
    """

    camera: Camera
    rate: float | None = None
    depth_scale: float | None = None
    t_bs: Array | None = None
    mask: Path | None = None
    body: bool = True


def of_keys(keys: Keys, topic: str = "") -> Calibration:
    """The calibration that a file or a message holds; all its keys are used, or passed over by name.

    Raises
    ------
    DataError
        Naming the key that is missing, not known or not allowed.
    """
    rate = _positive(keys, *_RATE)
    depth_scale = _positive(keys, *_DEPTH_SCALE)
    t_bs = None
    if keys.has("T_BS"):
        t_bs = _transform(keys, "T_BS")
    mask = _mask(keys) if keys.has("mask") else None
    return Calibration(camera_of_keys(keys, topic), rate, depth_scale, t_bs, mask, _body(keys))


def _mask(keys: Keys) -> Path:
    """The file that the key ``mask`` names; a calibration of others reaches no file but in its own folder."""
    name = keys.take("mask")
    if not isinstance(name, str) or not re.fullmatch(r"[^/\\\0]{1,255}", name) or name in (".", ".."):
        raise DataError(
            f"The key 'mask' of {keys.where} is no name of an image beside it; give one, as mask: hood.png."
        )
    return Path(name)


def _body(keys: Keys) -> bool:
    """What the key ``body`` says."""
    body = keys.take("body") if keys.has("body") else True
    if not isinstance(body, bool):
        raise DataError(
            f"The key 'body' of {keys.where} is {body!r}; give false where nobody wears the camera, or true."
        )
    return body


def _transform(keys: Keys, name: str) -> Array:
    return rigid(np.asarray(keys.numbers(name, count=(16,))).reshape(4, 4), f"{name} of {keys.where}")


def _positive(keys: Keys, *names: str) -> float | None:
    if not keys.has(*names):
        return None
    value = keys.number(*names)
    if not value > 0.0:
        raise DataError(
            f"The key '{next(filter(keys.has, names))}' of {keys.where} is not a positive number."
        )
    return value


def read_calibration(path: Path, *, name: str | None = None, topic: str = "") -> Calibration:
    """Read a calibration file.

    Parameters
    ----------
    path
        Of any kind that this module names.
    name
        Which camera of a camchain; that of the topic, of the file's or its folder's name, or ``cam0`` unless
        told.
    topic
        Of the images, which a camchain may name, and whose name may say that they are rectified.

    Raises
    ------
    DataError
        If the file is missing or broken, naming the key that is missing or not known.
    """
    path = Path(path)
    if not has_keys(path):
        return Calibration(camera_of_lines(path))
    with read_keys(path) as keys:
        cameras = [key for key in keys if re.fullmatch(r"cam\d+", key)]
        if not cameras:
            if name is not None:
                raise DataError(f"The calibration {path} has no camera '{name}'; it is of one camera alone.")
            return _placed(of_keys(keys, topic), path)
        beside = next((n for n in (path.stem, path.parent.name, "cam0") if n in cameras), cameras[0])
        chosen = name or _of_topic(keys, cameras, topic) or beside
        if chosen not in cameras:
            raise DataError(f"The calibration {path} has no camera '{chosen}'; it has {', '.join(cameras)}.")
        with keys.inside(chosen) as block:
            found = of_keys(block, topic)
        keys.leave(*cameras, why=f"other cameras than {chosen}")
        rate = _positive(keys, *_RATE)
    return _placed(found if rate is None else replace(found, rate=rate), path)


def _placed(found: Calibration, path: Path) -> Calibration:
    """With its mask beside the file."""
    return found if found.mask is None else replace(found, mask=path.parent / found.mask)


def _of_topic(keys: Keys, cameras: list[str], topic: str) -> str | None:
    """The camera of a camchain whose images a topic has; None if the camchain names no topics."""
    topics = {name: str(keys.peek(name).get("rostopic", "")).strip("/") for name in cameras}
    found = [name for name, named in topics.items() if named and _images(named) == _images(topic)]
    if topic and any(topics.values()) and len(cameras) > 1 and len(found) != 1:
        known = ", ".join(f"{name}: /{named}" for name, named in topics.items())
        raise DataError(
            f"The camchain {keys.where} does not say which of its cameras has the images of {topic} "
            f"({known}); correct 'rostopic', or give a file of one camera."
        )
    return found[0] if found else None


def _images(topic: str) -> str:
    return topic.removesuffix("/compressed").strip("/")


def load_camera(path: Path | str, name: str | None = None, topic: str = "") -> Camera:
    """The camera of a calibration file, of images with times of their own; see `read_calibration`."""
    return of_stamped(read_calibration(Path(path), name=name, topic=topic), path).camera


def of_stamped(found: Calibration, path: Path | str) -> Calibration:
    """What a file says of images with times of their own, which are believed more than its rate."""
    if found.rate is not None:
        tell("passed over", "rate (the images have times of their own)", path)
    return found


def load_unmasked(path: Path | str, topic: str = "") -> Camera:
    """As `load_camera`, where no mask can be used; raises DataError if the file names one."""
    found = read_calibration(Path(path), topic=topic)
    if found.mask is not None:
        raise DataError(
            f"The calibration {path} names a mask, which a live run does not read; take the key "
            "'mask' out, or give LiveSlam a Slam(mask=...)."
        )
    return found.camera


def pinhole_camera(k: Array, size: tuple[int, int], path: Path | str) -> Camera:
    """Camera without distortion of a 3x3 matrix K and its images' (width, height).

    Raises
    ------
    DataError
        Naming the file ``path`` that K was read from, if its numbers are not allowed.
    """
    tell("K", k, path)
    return lens("none", size, of_matrix(k.ravel().tolist(), str(path)), [], str(path))


def sensor_mapping(camera: Camera) -> dict[str, object]:
    """Content of a ``sensor.yaml`` that reads back as this camera."""
    return {
        "sensor_type": "camera",
        "camera_model": "pinhole",
        "resolution": [int(camera.width), int(camera.height)],
        "intrinsics": [float(x) for x in camera.intrinsics],
        "distortion_model": _DISTORTION_NAMES[camera.model],
        "distortion_coefficients": [float(x) for x in camera.distortion],
    }


def load_extrinsics(path: Path) -> Array:
    """``T_BS`` of an EuRoC ``sensor.yaml``: (4, 4), maps points of the sensor into the body.

    Raises
    ------
    DataError
        If the key is missing or is not a rigid pose.
    """
    t_bs = read_calibration(path).t_bs
    if t_bs is None:
        raise DataError(f"{path} lacks the key 'T_BS'; add it.")
    return t_bs


def load_rig(path: Path, topics: tuple[str, str] = ("", "")) -> tuple[Camera, Array, float]:
    """Another camera of a Kalibr camchain, as Cf bound to Cs.

    Parameters
    ----------
    path : Path
    topics : (str, str)
        Of the images of Cs and Cf, where the camchain names them; else they are ``cam0`` and ``cam1``.

    Returns
    -------
    camera : Camera
        Of Cf.
    t_cf : (4, 4) array
        Maps its points into Cs, by ``T_cn_cnm1``.
    shift : float
        Seconds to add to its stamps to be on the clock of Cs (the difference of ``timeshift_cam_imu``).

    Raises
    ------
    DataError
        If the file is not a camchain of two cameras, or the transform is missing or not rigid.
    """
    placed: dict[str, Array] = {}
    shifts: dict[str, float] = {}
    with read_keys(path) as keys:
        names = sorted((n for n in keys if re.fullmatch(r"cam\d+", n)), key=lambda n: int(n[3:]))
        if not {"cam0", "cam1"} <= set(names):
            raise DataError(
                f"The calibration {path} is no Kalibr camchain with cam0 and cam1; give one of both."
            )
        which = [_of_topic(keys, names, topic) for topic in topics]
        for name in names:
            with keys.inside(name) as block:
                t = np.eye(4)
                if placed:
                    t = _transform(block, "T_cn_cnm1") @ list(placed.values())[-1]
                placed[name] = t
                shifts[name] = block.number("timeshift_cam_imu") if block.has("timeshift_cam_imu") else 0.0
                block.leave("*", why="of the lens")
        _positive(keys, *_RATE)
    cs, cf = which[0] or "cam0", which[1] or "cam1"
    t_cf = placed[cs] @ pose_inverse(placed[cf])
    return load_camera(path, cf), t_cf, shifts[cf] - shifts[cs]


def check_resolution(camera: Camera, image: Image, path: Path | str) -> None:
    """`check_size` of an image."""
    height, width = image.shape[:2]
    check_size(camera, (width, height), path)


def check_size(camera: Camera, size: tuple[int, int], path: Path | str) -> None:
    """Check that an image has the size (width, height) that its camera was calibrated for.

    Raises
    ------
    DataError
        Giving both sizes and the fix.
    """
    width, height = size
    if (width, height) != (camera.width, camera.height):
        raise DataError(
            f"The image {path} is {width}x{height} but its camera is calibrated for "
            f"{camera.width}x{camera.height}; give the calibration of this resolution, or scale fx, fy, "
            "cx, cy with it."
        )

"""Camera calibrations: Kalibr camchain, EuRoC ``sensor.yaml``, OpenCV and ROS YAML files.

All become one :class:`collabslam._core.Camera`.  The models are METHOD section 4's: no distortion, OpenCV's
radial-tangential (k1 k2 p1 p2 and optionally k3), fisheye (equidistant, k1..k4), and Davison's wide-angle
model.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from collabslam._core import Camera
from collabslam.datasets.poses import rigid
from collabslam.errors import DataError
from collabslam.formats.files import read_text
from collabslam.formats.yaml_text import load_yaml
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Image

MODEL_OF_DISTORTION = {
    "none": "pinhole",
    "radtan": "radtan",
    "radial-tangential": "radtan",
    "plumb_bob": "radtan",
    "equidistant": "fisheye",
    "equi": "fisheye",
    "fisheye": "fisheye",
    "wideangle": "wideangle",
}
_DISTORTION_NAMES = {
    "pinhole": "none",
    "radtan": "radial-tangential",
    "fisheye": "equidistant",
    "wideangle": "wideangle",
}
_COEFFICIENTS = {"pinhole": (0,), "radtan": (4, 5), "fisheye": (4,), "wideangle": (1,)}


def read_yaml(path: Path) -> dict[str, Any]:
    """A YAML file as a dictionary; plain YAML, or OpenCV's FileStorage dialect.

    Raises
    ------
    DataError
        If the file is missing, not YAML, or not a mapping.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"The file {path} cannot be read as text; give an existing YAML file.") from error
    # All but OpenCV's header and tag is YAML; its own parser writes beyond its memory in broken files.
    body = "\n".join(line for line in text.splitlines() if not line.startswith("%"))
    body = body.replace("!!opencv-matrix", "")
    try:
        content = load_yaml(body)
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split())
        raise DataError(f"The file {path} is not valid YAML ({reason}); correct it.") from error
    if not isinstance(content, dict):
        raise DataError(f"The file {path} holds no 'key: value' lines; give a calibration in YAML.")
    return content


def _required(block: Mapping[str, Any], keys: tuple[str, ...], path: Path | str) -> Any:
    for key in keys:
        if block.get(key) is not None:
            return block[key]
    raise DataError(f"The calibration {path} lacks the key '{keys[0]}'; add it.")


def _numbers(value: Any, count: tuple[int, ...] | None, key: str, path: Path | str) -> list[float]:
    if isinstance(value, Mapping):
        value = value.get("data")
    try:
        # PyYAML reads 1e-05 as text, hence float() of each item.
        numbers = [float(x) for x in np.asarray(value, dtype=object).ravel().tolist()]
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(f"The key '{key}' of {path} is not a list of numbers; correct it.") from error
    if not bool(np.all(np.isfinite(numbers))):
        raise DataError(f"The key '{key}' of {path} holds a number that is not finite; correct it.")
    if count is not None and len(numbers) not in count:
        expected = " or ".join(str(c) for c in count)
        raise DataError(f"The key '{key}' of {path} has {len(numbers)} numbers; {expected} are needed.")
    return numbers


def _pick(content: Mapping[str, Any], name: str | None, path: Path | str) -> Mapping[str, Any]:
    """The block of one camera: the named one of a Kalibr camchain, or the whole file."""
    chain = {k: v for k, v in content.items() if isinstance(v, Mapping) and "intrinsics" in v}
    if not chain:
        return content
    wanted = name if name is not None else ("cam0" if "cam0" in chain else sorted(chain)[0])
    if wanted not in chain:
        raise DataError(
            f"The calibration {path} has no camera '{wanted}'; it has {', '.join(sorted(chain))}."
        )
    block: Mapping[str, Any] = chain[wanted]
    return block


def _distortion(block: Mapping[str, Any], path: Path | str) -> tuple[str, list[float]]:
    keys = ("distortion_coefficients", "distortion_coeffs")
    value: Any = next((block[k] for k in keys if block.get(k) is not None), [])
    coefficients = _numbers(value, None, keys[0], path)
    named = block.get("distortion_model")
    if named is None:
        named = "fisheye" if block.get("fisheye") else ("radtan" if coefficients else "none")
    model = MODEL_OF_DISTORTION.get(str(named).strip().lower())
    if model is None:
        known = ", ".join(MODEL_OF_DISTORTION)
        raise DataError(
            f"The distortion model '{named}' of {path} is not supported; calibrate with one of: {known}."
        )
    if not coefficients and model == "radtan":
        model = "pinhole"
    return model, _numbers(coefficients, _COEFFICIENTS[model], keys[0], path)


def camera_from_mapping(content: Mapping[str, Any], path: Path | str, name: str | None = None) -> Camera:
    """Camera of the content of a calibration file; ``path`` serves the messages.

    Raises
    ------
    DataError
        Naming the missing key, or the value that is not allowed.
    """
    block = _pick(content, name, path)
    if "camera_matrix" in block:
        k = _numbers(block["camera_matrix"], (9,), "camera_matrix", path)
        intrinsics = [k[0], k[4], k[2], k[5]]
        sizes = [_required(block, ("image_width",), path), _required(block, ("image_height",), path)]
        resolution = _numbers(sizes, (2,), "image_width", path)
    else:
        projection = str(block.get("camera_model", "pinhole")).strip().lower()
        if projection != "pinhole":
            raise DataError(
                f"The camera model '{projection}' of {path} is not supported; calibrate as 'pinhole' with "
                "the distortion model radtan or equidistant."
            )
        intrinsics = _numbers(_required(block, ("intrinsics",), path), (4,), "intrinsics", path)
        resolution = _numbers(_required(block, ("resolution",), path), (2,), "resolution", path)
    model, coefficients = _distortion(block, path)
    try:
        return Camera(model, int(resolution[0]), int(resolution[1]), intrinsics, coefficients)
    except (ValueError, OverflowError) as error:
        raise DataError(f"The calibration {path} is not usable: {error}") from error


def load_camera(path: Path | str, name: str | None = None) -> Camera:
    """Read a camera calibration.

    Parameters
    ----------
    path
        Kalibr camchain, EuRoC ``sensor.yaml``, OpenCV FileStorage or ROS CameraInfo YAML file.
    name
        Which camera of a camchain; ``cam0`` unless told.

    Raises
    ------
    DataError
        If the file is missing or broken, naming the missing key.
    """
    return camera_from_mapping(read_yaml(Path(path)), Path(path), name)


def pinhole_camera(k: Array, size: tuple[int, int], path: Path | str) -> Camera:
    """Camera without distortion of a 3x3 matrix K and its images' (width, height).

    Raises
    ------
    DataError
        Naming the file ``path`` that K was read from, if its numbers are not allowed.
    """
    if not np.array_equal(k[2], (0.0, 0.0, 1.0)):
        raise DataError(f"The last row of the 3x3 matrix in {path} is not 0 0 1; give K row by row.")
    try:
        return Camera("pinhole", *size, (k[0, 0], k[1, 1], k[0, 2], k[1, 2]), [])
    except (ValueError, OverflowError) as error:
        raise DataError(f"The calibration {path} is not usable: {error}") from error


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
        If the key is missing or is no rigid pose.
    """
    numbers = _numbers(_required(read_yaml(path), ("T_BS",), path), (16,), "T_BS", path)
    return rigid(np.asarray(numbers).reshape(4, 4), f"T_BS of {path}")


def load_rig(path: Path) -> tuple[Camera, Array, float]:
    """The second camera of a Kalibr camchain, as Cf bound to Cs, the first.

    Returns
    -------
    camera : Camera
        Of ``cam1``.
    t_cf : (4, 4) array
        Maps its points into ``cam0``: the inverse of ``T_cn_cnm1``.
    shift : float
        Seconds to add to its stamps to be on the clock of ``cam0`` (the difference of ``timeshift_cam_imu``).

    Raises
    ------
    DataError
        If the file is no camchain of two cameras, or the transform is missing or not rigid.
    """
    content = read_yaml(path)
    first, second = content.get("cam0"), content.get("cam1")
    if not isinstance(first, Mapping) or not isinstance(second, Mapping):
        raise DataError(f"The calibration {path} is no Kalibr camchain with cam0 and cam1; give one of both.")
    numbers = _numbers(_required(second, ("T_cn_cnm1",), path), (16,), "T_cn_cnm1", path)
    t_fc = rigid(np.asarray(numbers).reshape(4, 4), f"T_cn_cnm1 of {path}")
    shifts = [
        _numbers(block.get("timeshift_cam_imu", 0.0), (1,), "timeshift_cam_imu", path)[0]
        for block in (first, second)
    ]
    return camera_from_mapping(content, path, "cam1"), pose_inverse(t_fc), shifts[1] - shifts[0]


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

"""Camera calibrations of every kind that people have: which keys of which program's files mean what.

Read are Kalibr camchains, EuRoC ``sensor.yaml``, OpenCV's and ROS's files and messages, the settings of VINS
and ORB-SLAM, COLMAP's ``cameras.txt``, nerfstudio's ``transforms.json``, Record3D's ``metadata``,
ARKitScenes' ``.pincam`` and SceneLib2's JSON.  All become one `collabslam._core.Camera`; see
`collabslam.datasets.lens`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.gate import Keys, data_lines, read_keys, tell, text_of
from collabslam.datasets.lens import MODELS, lens, of_matrix
from collabslam.datasets.poses import rigid
from collabslam.errors import DataError
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Image

_MATRIX = ("camera_matrix", "cameraMatrix", "camera_mat", "intrinsic_matrix", "mtx", "K", "k")
_DISTORTION = (
    "distortion_coefficients", "distortion_coeffs", "distortionCoefficients", "dist_coeffs", "dist_coeff",
    "dist_coefs", "distCoeffs", "dist", "distortion", "D", "d",
)  # fmt: skip
_SIZE = ("resolution", "image_size", "imageSize", "img_size")
_WIDTH, _HEIGHT = ("image_width", "imageWidth", "width", "w"), ("image_height", "imageHeight", "height", "h")
_PROJECTION = ("projection_matrix", "P", "p")
_RATE = ("rate", "Camera.fps", "fps")
_DEPTH_SCALE = ("depth_scale", "DepthMapFactor", "RGBD.DepthMapFactor")
_NO_LENS = (
    "comment*", "camera_name", "sensor_type", "rate_hz", "header", "rectification_matrix", "R", "r", "*time",
    "n*frames*", "nr_of_*", "board*", "square*", "marker*", "pattern*", "flags", "*reproj*", "*_error*",
    "rms*", "image_points", "grid_points", "extrinsic_parameters", "aspect*", "fix*", "cam_overlaps",
    "T_cam_imu", "T_imu_cam", "line_delay", "T_cn_cnm1", "rostopic", "timeshift_cam_imu",
)  # fmt: skip
"""Keys of calibrations that say nothing of the lens."""
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
    """

    camera: Camera
    rate: float | None = None
    depth_scale: float | None = None
    t_bs: Array | None = None
    mask: Path | None = None


def is_rectified(topic: str) -> bool:
    """Whether a topic's name says that its images are rectified: their lens is P, without distortion."""
    return re.search(r"(^|[/_])rect(ified)?([/_]|$)", topic) is not None


def of_keys(keys: Keys, topic: str = "") -> Calibration:
    """The calibration that a file or a message holds; all its keys are used, or passed over by name.

    Raises
    ------
    DataError
        Naming the key that is missing, not known or not allowed.
    """
    program = next((read for own, read in _PROGRAMS if keys.has(*own)), _opencv)
    rate = _positive(keys, *_RATE)
    depth_scale = _positive(keys, *_DEPTH_SCALE)
    t_bs = None
    if keys.has("T_BS"):
        t_bs = _transform(keys, "T_BS")
    mask = _mask(keys) if keys.has("mask") else None
    return Calibration(program(keys, topic), rate, depth_scale, t_bs, mask)


def _mask(keys: Keys) -> Path:
    """The file that the key ``mask`` names; a calibration of others reaches no file but in its own folder."""
    name = keys.take("mask")
    if not isinstance(name, str) or not re.fullmatch(r"[^/\\\0]{1,255}", name) or name in (".", ".."):
        raise DataError(
            f"The key 'mask' of {keys.where} is no name of an image beside it; give one, as mask: hood.png."
        )
    return Path(name)


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


def _opencv(keys: Keys, topic: str) -> Camera:
    """Kalibr's block of a camera, EuRoC's, OpenCV's and ROS's files, and what follows their names."""
    where = keys.where
    own = keys.take("camera_model") if keys.has("camera_model") else None
    model = "none" if own is None else str(own)
    if is_rectified(topic):
        projection = keys.numbers(*_PROJECTION, count=(12,))
        intrinsics = [projection[k] for k in (0, 5, 2, 6)]
        why = (
            f"the images of {topic} are rectified: {'P' if keys.has('P', 'p') else 'projection_matrix'} holds"
        )
        keys.leave(*_MATRIX, *_DISTORTION, "distortion_model", "intrinsics", *_NO_LENS, why=why)
        return lens("none", _size(keys), intrinsics, [], where)
    if keys.has(*_MATRIX):
        intrinsics = of_matrix(keys.numbers(*_MATRIX, count=(9,)), where)
    else:
        intrinsics = keys.numbers("intrinsics")
        intrinsics = of_matrix(intrinsics, where) if len(intrinsics) == 9 else intrinsics
    size = _size(keys)
    given = keys.has(*_DISTORTION)
    coefficients = keys.numbers(*_DISTORTION) if given else []
    named = keys.take("distortion_model")
    fisheye = bool(keys.take("fisheye_model", "fisheye"))
    distortion = "fisheye" if fisheye else str(named or ("radtan" if coefficients else "none"))
    undistorted = keys.has(*_PROJECTION) and not coefficients and _same_as_p(keys, intrinsics)
    keys.leave(*_NO_LENS, *_PROJECTION)
    if model.strip().lower() not in ("pinhole", "none"):
        if len(intrinsics) == 4 or MODELS.get(distortion.strip().lower()) not in ("pinhole", "radtan"):
            raise DataError(
                f"The camera model '{model}' of {where} does not have such numbers; calibrate as 'pinhole'."
            )
        return lens(model, size, intrinsics, coefficients, where)
    if len(intrinsics) != 4:
        raise DataError(f"The key 'intrinsics' of {where} has {len(intrinsics)} numbers; 4 are needed.")
    if undistorted and MODELS.get(distortion.strip().lower()) == "radtan":
        distortion = "none"
    return lens(distortion, size, intrinsics, coefficients, where)


def _same_as_p(keys: Keys, intrinsics: list[float]) -> bool:
    """Whether the projection of rectified images is that of the raw ones: then there is no distortion."""
    p = keys.numbers(*_PROJECTION, count=(12,))
    return bool(np.allclose([p[k] for k in (0, 5, 2, 6)], intrinsics))


def _size(keys: Keys) -> list[float]:
    if keys.has(*_SIZE):
        return keys.numbers(*_SIZE, count=(2,))
    if not keys.has(*_WIDTH) and not keys.has(*_MATRIX) and keys.has("intrinsics"):
        keys.need(*_SIZE)
    return [keys.number(*_WIDTH), keys.number(*_HEIGHT)]


def _vins(keys: Keys, _: str) -> Camera:
    """The lens of VINS-Mono and VINS-Fusion (camodocal)."""
    kind = str(keys.need("model_type")).upper()
    with keys.inside("projection_parameters") as p, keys.inside("distortion_parameters") as d:
        if kind == "KANNALA_BRANDT":
            intrinsics, coefficients = _each(p, "mu mv u0 v0"), _each(p, "k2 k3 k4 k5")
            model = "fisheye"
        elif kind == "MEI":
            with keys.inside("mirror_parameters") as mirror:
                intrinsics = [mirror.number("xi"), *_each(p, "gamma1 gamma2 u0 v0")]
            model, coefficients = "omni", _each(d, "k1 k2 p1 p2")
        elif kind in ("PINHOLE", "PINHOLE_FULL"):
            intrinsics, model = _each(p, "fx fy cx cy"), "radtan"
            coefficients = _each(d, "k1 k2 p1 p2" if kind == "PINHOLE" else "k1 k2 p1 p2 k3 k4 k5 k6")
        else:
            raise DataError(
                f"The model_type '{kind}' of {keys.where} is not known; PINHOLE, MEI or KANNALA_BRANDT is."
            )
    size = _size(keys)
    keys.leave("*", why="settings of VINS, not of the lens")
    return lens(model, size, intrinsics, coefficients, keys.where)


def _orb_slam(keys: Keys, _: str) -> Camera:
    """The first camera of the settings of ORB-SLAM2 and 3."""
    own = "Camera1." if keys.has("Camera1.fx") else "Camera."
    kind = str(keys.take("Camera.type") if keys.has("Camera.type") else "PinHole")
    intrinsics = _each(keys, "fx fy cx cy", own)
    model = {"pinhole": "radtan", "kannalabrandt8": "fisheye", "rectified": "none"}.get(kind.lower())
    if model is None:
        raise DataError(
            f"The Camera.type '{kind}' of {keys.where} is not known; PinHole or KannalaBrandt8 is."
        )
    names = {"radtan": "k1 k2 p1 p2", "fisheye": "k1 k2 k3 k4", "none": ""}[model]
    more = " k3" if model == "radtan" and keys.has(f"{own}k3") else ""
    coefficients = _each(keys, names + more, own)
    size = [keys.number("Camera.width"), keys.number("Camera.height")]
    why = "settings of ORB-SLAM, not of this lens"
    keys.leave("Camera2.*", "Camera.[!kp]*", "[!C]*", why=why)
    return lens(model, size, intrinsics, coefficients, keys.where)


def _nerfstudio(keys: Keys, _: str) -> Camera:
    """The lens of a ``transforms.json``, whose pixels begin at their corners, as COLMAP's do."""
    frames = keys.take("frames") or []
    if any(isinstance(frame, Mapping) and "fl_x" in frame for frame in frames):
        raise DataError(f"{keys.where} has a lens of each frame; give a camera whose lens stays as it is.")
    kind = str(keys.take("camera_model") if keys.has("camera_model") else "OPENCV").upper()
    fx = keys.number("fl_x")
    fy = keys.number("fl_y") if keys.has("fl_y") else fx
    names = {"OPENCV": "k1 k2 p1 p2", "OPENCV_FISHEYE": "k1 k2 k3 k4"}.get(kind, "")
    if kind not in ("OPENCV", "OPENCV_FISHEYE", "PINHOLE", "SIMPLE_PINHOLE"):
        raise DataError(
            f"The camera_model '{kind}' of {keys.where} is not known; OPENCV or OPENCV_FISHEYE is."
        )
    coefficients = [keys.number(name) if keys.has(name) else 0.0 for name in names.split()]
    if kind == "OPENCV" and keys.has("k3"):
        coefficients.append(keys.number("k3"))
    zero = [name for name in ("k3", "k4", "p1", "p2") if keys.has(name) and keys.number(name) == 0.0]
    centre = [keys.number("cx") - 0.5, keys.number("cy") - 0.5]
    keys.leave(
        "camera_angle_*", "applied_*", "orientation_override", "ply_file_path", "aabb*", "scale", "offset",
        "*_filenames", *zero,
    )  # fmt: skip
    model = "fisheye" if kind == "OPENCV_FISHEYE" else "radtan" if any(coefficients) else "none"
    return lens(model, _size(keys), [fx, fy, *centre], coefficients if model != "none" else [], keys.where)


def _record3d(keys: Keys, _: str) -> Camera:
    """The lens of Record3D's ``metadata``, whose K is column by column."""
    k = np.asarray(keys.numbers("K", count=(9,))).reshape(3, 3).T
    size = _size(keys)
    keys.leave("poses", "initPose", "perFrame*", "d[wh]", "cameraType", "frameTimestamps", "*imestamps")
    return lens("none", size, of_matrix(k.ravel().tolist(), keys.where), [], keys.where)


def _scenelib(keys: Keys, _: str) -> Camera:
    """The lens of SceneLib2's JSON."""
    model = str(keys.need("model"))
    intrinsics = _each(keys, "focal_length_x focal_length_y principal_point_x principal_point_y")
    coefficients = [keys.number("radial_distortion_x")]
    for name in ("skew", "tangential_distortion_x", "tangential_distortion_y"):
        if keys.has(name) and keys.number(name) != 0.0:
            raise DataError(f"The key '{name}' of {keys.where} is not zero; calibrate without it.")
    keys.leave("radial_distortion_y", "measurement_noise")
    return lens(model, _size(keys), intrinsics, coefficients, keys.where)


def _elsewhere(keys: Keys, _: str) -> Camera:
    other = keys.take("cam0_calib")
    raise DataError(f"{keys.where} has its lens in another file ({other}); give that one with --camera.")


def _each(keys: Keys, names: str, prefix: str = "") -> list[float]:
    return [keys.number(prefix + name) for name in names.split()]


_PROGRAMS: tuple[tuple[tuple[str, ...], Callable[[Keys, str], Camera]], ...] = (
    (("projection_parameters", "model_type"), _vins),
    (("Camera.fx", "Camera1.fx", "Camera.type"), _orb_slam),
    (("fl_x", "camera_angle_x"), _nerfstudio),
    (("poses", "perFrameIntrinsicCoeffs"), _record3d),
    (("focal_length_x",), _scenelib),
    (("cam0_calib",), _elsewhere),
)
"""Keys that only one program's files have, and how those are read."""

_COLMAP = {
    "SIMPLE_PINHOLE": ("none", "f cx cy"),
    "PINHOLE": ("none", "fx fy cx cy"),
    "SIMPLE_RADIAL": ("radtan", "f cx cy k1"),
    "RADIAL": ("radtan", "f cx cy k1 k2"),
    "OPENCV": ("radtan", "fx fy cx cy k1 k2 p1 p2"),
    "FULL_OPENCV": ("radtan", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    "OPENCV_FISHEYE": ("fisheye", "fx fy cx cy k1 k2 k3 k4"),
    "SIMPLE_RADIAL_FISHEYE": ("fisheye", "f cx cy k1"),
    "RADIAL_FISHEYE": ("fisheye", "f cx cy k1 k2"),
    "FOV": ("fov", "fx fy cx cy omega"),
}
"""COLMAP's models: ours, and the order of their parameters."""
_ORDER = {"none": "", "radtan": "k1 k2 p1 p2 k3 k4 k5 k6", "fisheye": "k1 k2 k3 k4", "fov": "omega"}


def _of_lines(path: Path) -> Calibration:
    """A calibration without keys: COLMAP's ``cameras.txt``, or ``.pincam`` (width height fx fy cx cy)."""
    lines = [fields for _, fields in data_lines(path)]
    first = lines[0] if len(lines) == 1 else []
    try:
        if len(first) > 4 and first[1] in _COLMAP:
            model, names = _COLMAP[first[1]]
            size, numbers = [float(v) for v in first[2:4]], [float(v) for v in first[4:]]
            told = dict(zip(names.split(), numbers, strict=True))
            f = told.get("f", 0.0)
            intrinsics = [told.get("fx", f), told.get("fy", f), told["cx"] - 0.5, told["cy"] - 0.5]
            coefficients = [told.get(name, 0.0) for name in _ORDER[model].split()]
            tell(f"COLMAP's {first[1]}", numbers, path)
            return Calibration(lens(model, size, intrinsics, coefficients, str(path)))
        if len(first) == 6:
            numbers = [float(v) for v in first]
            tell("width height fx fy cx cy", numbers, path)
            return Calibration(lens("none", numbers[:2], numbers[2:], [], str(path)))
    except ValueError as error:
        raise DataError(
            f"The calibration {path} has not the numbers of its model ({error}); correct it."
        ) from error
    raise DataError(
        f"The file {path} holds no 'key: value' lines, nor a single camera of COLMAP's cameras.txt; give a "
        "calibration in YAML."
    )


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
    if not re.search(r"^[^#\n]*:|^\s*\{", text_of(path), re.MULTILINE):
        return _of_lines(path)
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
    """The camera of a calibration file; see `read_calibration`."""
    return read_calibration(Path(path), name=name, topic=topic).camera


def load_unmasked(path: Path | str, name: str | None = None, topic: str = "") -> Camera:
    """As `load_camera`, where no mask can be used; raises DataError if the file names one."""
    found = read_calibration(Path(path), name=name, topic=topic)
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

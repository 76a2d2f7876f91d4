"""The lens in files and messages with keys: which keys of which program mean what.

Read are Kalibr camchains, EuRoC ``sensor.yaml``, OpenCV's and ROS's files and messages, plain ``fx: ..`` as
many scripts and RealSense's tools write it, the settings of VINS, ORB-SLAM and its descendants, Basalt's
JSON, nerfstudio's and instant-ngp's ``transforms.json``, Record3D's ``metadata`` and SceneLib2's JSON.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.gate import Keys, tell
from collabslam.datasets.lens import lens, model_of, of_matrix
from collabslam.errors import DataError

_MATRIX = (
    "camera_matrix",
    "cameraMatrix",
    "camera_mat",
    "intrinsic_matrix",
    "mtx",
    "K",
    "k",
    "Camera_Matrix",
)
_DISTORTION = (
    "distortion_coefficients", "distortion_coeffs", "distortionCoefficients", "dist_coeffs", "dist_coeff",
    "dist_coefs", "distCoeffs", "dist", "distortion", "coeffs", "D", "d", "Distortion_Coefficients",
)  # fmt: skip
_SIZE = ("resolution", "image_size", "imageSize", "img_size", "DIM", "imageResolution")
_WIDTH = ("image_width", "imageWidth", "image_Width", "width", "w", "cols")
_HEIGHT = ("image_height", "imageHeight", "image_Height", "height", "h", "rows")
_MODEL = ("distortion_model", "model")
_COEFFICIENTS = "k1 k2 p1 p2 k3 k4 k5 k6"
_PROJECTION = ("projection_matrix", "P", "p")
_NO_LENS = (
    "comment*", "camera_name", "calibration_Time", "nrOfFrames", "flagValue", "FixAspectRatio", "Avg_*",
    "Per_View_*", "Extrinsic_Parameters", "Image_points", "sensor_type", "rate_hz", "header",
    "rectification_matrix", "R", "r", "*time", "n*frames*", "nr_of_*", "board*", "square*", "marker*",
    "pattern*", "flags", "*reproj*", "*_error*", "rms*", "image_points", "grid_points",
    "extrinsic_parameters", "aspect*", "fix*", "cam_overlaps", "T_cam_imu", "T_imu_cam", "local_transform",
    "line_delay", "T_cn_cnm1", "rostopic", "timeshift_cam_imu",
)  # fmt: skip
"""Keys of calibrations that say nothing of the lens."""


def camera_of_keys(keys: Keys, topic: str = "") -> Camera:
    """The camera of a file or a message; keys that a program is known to write beside it are left by name.

    Parameters
    ----------
    keys : Keys
    topic : str
        Of the images, whose name may say that they are rectified.

    Raises
    ------
    DataError
        Naming the key that is missing or not allowed.
    """
    program = next((read for own, read in _PROGRAMS if all(map(keys.has, own))), _opencv)
    return program(keys, topic)


def is_rectified(topic: str) -> bool:
    """Whether a topic's name says that its images are rectified: their lens is P, without distortion."""
    return re.search(r"(^|[/_])rect(ified)?([/_]|$)|Rect(ified)?([/_A-Z]|$)", topic) is not None


def _is_undistorted(topic: str) -> bool:
    """Whether a topic's name says that its images have no distortion any more, but not by which lens."""
    return re.search(r"undist(ort(ed)?)?([/_A-Z]|$)", topic, re.IGNORECASE) is not None


def _opencv(keys: Keys, topic: str) -> Camera:
    """Kalibr's block of a camera, EuRoC's, OpenCV's and ROS's files, and what follows their names."""
    where = keys.where
    _check_whole(keys)
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
        intrinsics = of_matrix(_matrix(keys), where)
    elif not keys.has("intrinsics"):
        raise _unknown(keys)
    else:
        intrinsics = keys.numbers("intrinsics")
        intrinsics = of_matrix(intrinsics, where) if len(intrinsics) == 9 else intrinsics
    size = _size(keys)
    given = keys.has(*_DISTORTION)
    coefficients = keys.numbers(*_DISTORTION) if given else []
    named = keys.take(*_MODEL)
    stated = keys.take("fisheye_model", "fisheye")
    distortion = "fisheye" if stated else str(named or ("radtan" if coefficients else "none"))
    if not named and stated is None:
        _check_unnamed(coefficients, where)
    if _is_undistorted(topic) and any(coefficients):
        raise DataError(
            f"The images of {topic} are undistorted by their name, and {where} has the lens of the raw ones; "
            "give --camera FILE with the lens of the undistorted ones."
        )
    undistorted = keys.has(*_PROJECTION) and not coefficients and _same_as_p(keys, intrinsics)
    keys.leave(*_NO_LENS, *_PROJECTION)
    if model.strip().lower() not in ("pinhole", "none"):
        if len(intrinsics) == 4 or model_of(distortion) not in ("pinhole", "radtan"):
            raise DataError(
                f"The camera model '{model}' of {where} does not have such numbers; calibrate as 'pinhole'."
            )
        return lens(model, size, intrinsics, coefficients, where)
    if len(intrinsics) != 4:
        points = " (decimal commas? write points)" if len(intrinsics) > 6 else ""
        raise DataError(
            f"The key 'intrinsics' of {where} has {len(intrinsics)} numbers; 4 are needed{points}."
        )
    if undistorted and model_of(distortion) == "radtan":
        distortion = "none"
    return lens(distortion, size, intrinsics, coefficients, where)


def _check_whole(keys: Keys) -> None:
    """Refuses a CameraInfo of binned or cropped images; a region as large as the picture crops nothing."""
    binned = max(keys.number(name) if keys.has(name) else 0.0 for name in ("binning_x", "binning_y"))
    size = [keys.peek_number(*names) for names in (_WIDTH, _HEIGHT)]
    with keys.inside("roi") as roi:
        names = ("x_offset", "y_offset", "width", "height")
        left, top, *region = [roi.number(name) if roi.has(name) else 0.0 for name in names]
        roi.leave("do_rectify")
    if binned > 1 or (left, top) != (0, 0) or region not in ([0, 0], size):
        raise DataError(f"{keys.where} is for binned or cropped images; give --camera FILE for these images.")


def _matrix(keys: Keys) -> list[float]:
    """K row by row; Open3D's ``intrinsic_matrix`` is a list column by column."""
    k = keys.numbers(*_MATRIX, count=(9,))
    if keys.has("intrinsic_matrix") and k[2] == k[5] == 0.0 and k[8] == 1.0 and min(k[6:8]) > 0.0:
        return [k[row + 3 * column] for row in range(3) for column in range(3)]
    return k


def _check_unnamed(coefficients: Sequence[float], where: str) -> None:
    """Refuses four numbers of which nobody says whether they are a fisheye's: OpenCV's has as many.

    The last two of a radial-tangential lens are tangential, and small beside its first.
    """
    if len(coefficients) == 4 and max(map(abs, coefficients[2:])) > min(0.01, 0.1 * abs(coefficients[0])):
        raise DataError(
            f"{where} has four numbers of distortion and does not say of which lens; add 'distortion_model: "
            "equidistant' (of cv2.fisheye) or 'distortion_model: radtan'."
        )


def _unknown(keys: Keys) -> DataError:
    found = ", ".join(f"'{key}'" for key in list(keys)[:6])
    return DataError(
        f"{keys.where} lacks the key 'intrinsics'; add it (fx, fy, cx, cy), or 'camera_matrix', with "
        "'distortion_model', 'distortion_coefficients', 'image_width' and 'image_height': of what it has "
        f"({found}) nothing is known to be a lens."
    )


def _plain(keys: Keys, _: str) -> Camera:
    """``fx``, ``fy``, ``cx``, ``cy`` by themselves, as scripts, RealSense's tools and Polycam write them."""
    where = keys.where
    intrinsics = [keys.number(*names) for names in (("fx",), ("fy",), ("cx", "ppx"), ("cy", "ppy"))]
    name = str(keys.take(*_MODEL, "camera_model") or "")
    kind = model_of(name)
    if keys.has(*_DISTORTION):
        coefficients = keys.numbers(*_DISTORTION)
    else:
        given = {k: keys.number(k) for k in _COEFFICIENTS.split() if keys.has(k)}
        fisheye = kind == "fisheye" or (not name and "k4" in given and "p1" not in given)
        order = "k1 k2 k3 k4" if fisheye else _COEFFICIENTS
        coefficients = [given.pop(k, 0.0) for k in order.split()]
        if any(given.values()):
            raise DataError(
                f"{where} has a '{next(iter(given))}', which its lens '{name}' has not; correct it."
            )
        while coefficients and coefficients[-1] == 0.0:
            coefficients.pop()
        if coefficients:
            coefficients += [0.0] * (4 - len(coefficients))
    if not name:
        _check_unnamed(coefficients, where)
    keys.leave("blur_score", "timestamp", "t_[0-9][0-9]", "*_depth", *_NO_LENS)
    straight = kind in ("pinhole", "radtan", None) and not any(coefficients)
    if straight and (kind or not name):
        name, coefficients = "none", []
    elif kind == "pinhole":
        name = "radtan"
    return lens(name, _size(keys), intrinsics, coefficients, where)


def _basalt(keys: Keys, _: str) -> Camera:
    """The first camera of Basalt's JSON."""
    with keys.inside("value0") as value:
        cameras, sizes = value.need("intrinsics"), value.need("resolution")
        value.leave("*", why="of other sensors")
    if not (isinstance(cameras, list) and cameras and isinstance(cameras[0], Mapping) and sizes):
        raise DataError(
            f"{keys.where} has no camera in 'value0'; give Basalt's calibration as it was written."
        )
    tell("camera", f"0 of {len(cameras)}", keys.where)
    with Keys(cameras[0], keys.where, "value0.intrinsics.0.") as first:
        kind = str(first.need("camera_type"))
        with first.inside("intrinsics") as numbers:
            last = _each(numbers, "fx fy cx cy")
            own = {"ds": "xi alpha", "eucm": "alpha beta"}.get(kind, "")
            distortion = {"kb4": "k1 k2 k3 k4", "pinhole-radtan8": _COEFFICIENTS}.get(kind, "")
            coefficients = _each(numbers, distortion)
            intrinsics = [*_each(numbers, own), *last]
            numbers.leave("rpmax")
    size = np.asarray(sizes[0], dtype=np.float64).ravel().tolist()
    return lens(kind, size, intrinsics, coefficients, keys.where)


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
            coefficients = _each(d, "k1 k2 p1 p2" if kind == "PINHOLE" else _COEFFICIENTS)
        else:
            raise DataError(
                f"The model_type '{kind}' of {keys.where} is not known; PINHOLE, MEI or KANNALA_BRANDT is."
            )
    size = _size(keys)
    keys.leave("*", why="settings of VINS, not of the lens")
    return lens(model, size, intrinsics, coefficients, keys.where)


def _orb_slam(keys: Keys, _: str) -> Camera:
    """The first camera of the settings of ORB-SLAM2 and 3, OpenVSLAM and stella_vslam."""
    if keys.peek("Camera"):
        with keys.inside("Camera") as block:
            camera = _orb_lens(block, "", "")
        keys.leave("*", why="settings of stella_vslam, not of this lens")
        return camera
    camera = _orb_lens(keys, "Camera1." if keys.has("Camera1.fx") else "Camera.", "Camera.")
    keys.leave("[!C]*", why="settings of ORB-SLAM, not of this lens")
    return camera


def _orb_lens(keys: Keys, own: str, general: str) -> Camera:
    kind = str(keys.take(f"{general}type", f"{general}model") or "PinHole")
    intrinsics = _each(keys, "fx fy cx cy", own)
    known = {"pinhole": "radtan", "perspective": "radtan", "kannalabrandt8": "fisheye", "fisheye": "fisheye"}
    model = (known | {"rectified": "none"}).get(kind.lower())
    if model is None:
        raise DataError(
            f"The {general}type '{kind}' of {keys.where} is not known; PinHole or KannalaBrandt8 is."
        )
    names = {"radtan": "k1 k2 p1 p2", "fisheye": "k1 k2 k3 k4", "none": ""}[model]
    more = " k3" if model == "radtan" and keys.has(f"{own}k3") else ""
    coefficients = _each(keys, names + more, own)
    size = [
        keys.number(general + "width", general + "cols"),
        keys.number(general + "height", general + "rows"),
    ]
    why = "settings of ORB-SLAM, not of this lens"
    keys.leave("Camera2.*", f"{general}[!kp]*", why=why)
    return lens(model, size, intrinsics, coefficients, keys.where)


def _nerfstudio(keys: Keys, _: str) -> Camera:
    """The lens of a ``transforms.json``, whose pixels begin at their corners, as COLMAP's do."""
    frames = keys.take("frames") or []
    if any(isinstance(frame, Mapping) and "fl_x" in frame for frame in frames):
        raise DataError(f"{keys.where} has a lens of each frame; give a camera whose lens stays as it is.")
    usual = "OPENCV_FISHEYE" if keys.take("is_fisheye") else "OPENCV"
    kind = str(keys.take("camera_model") if keys.has("camera_model") else usual).upper()
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
    (("projection_parameters",), _vins),
    (("model_type",), _vins),
    (("Camera.fx",), _orb_slam),
    (("Camera1.fx",), _orb_slam),
    (("Camera.type",), _orb_slam),
    (("Camera",), _orb_slam),
    (("fl_x",), _nerfstudio),
    (("camera_angle_x",), _nerfstudio),
    (("poses",), _record3d),
    (("perFrameIntrinsicCoeffs",), _record3d),
    (("focal_length_x",), _scenelib),
    (("cam0_calib",), _elsewhere),
    (("value0",), _basalt),
    (("fx", "fy"), _plain),
)
"""Keys that only one program's files have, and how those are read."""

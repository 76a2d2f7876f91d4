"""A lens as other programs describe it, as a camera of ours, all numbers checked.

Ours are METHOD section 4's: no distortion, OpenCV's radial-tangential and rational (k1 k2 p1 p2 k3 k4 k5 k6),
its fisheye (equidistant, k1..k4), and Davison's wide angle.  Double sphere, extended unified, omnidirectional
and field-of-view lenses are carried to a fisheye that agrees with them all over the picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.gate import tell
from collabslam.errors import DataError
from collabslam.types import Array

MODELS = {**dict(Camera.models()), "fov": "fov", "ds": "ds", "eucm": "eucm"}
"""Our name of each model of distortion, or that of one which is carried to a fisheye."""
_ALSO = {
    "kannala_brandt4": "fisheye", "kannalabrandt": "fisheye", "kb4": "fisheye", "opencv_fisheye": "fisheye",
    "radtan8": "radtan", "radial_tangential8": "radtan", "full_opencv": "radtan",
}  # fmt: skip
"""Further names, in the form that `model_of` looks for."""
_INVERSE = "inverse_brown_conrady"
"""RealSense's colour cameras: its numbers lead from distorted to undistorted, and are often all 0."""
COUNTS = {"pinhole": (0,), "radtan": (4, 5, 8), "fisheye": (4,), "wideangle": (1,)}
_MOST_RATIO = 3.0
"""Of fx to fy, either way."""
_LEAST_FOCAL = 0.05
"""Share of the picture's larger side below which a focal length is not in pixels."""
_ALIKE = 0.2
"""By which share focal lengths, and the centre and the picture's middle, differ at most as a rule."""
_CENTRED = 0.05
"""Share of the size by which a centre is off the middle at most, and focal lengths are unlike, as a rule."""
_MOST_APART = 1.0
"""Pixels by which a lens may be off that was carried to another model."""
_DECIMALS = 4
"""So many numbers of a distortion are not all whole."""
_STEEPEST = 0.05
"""Least cosine of a ray to the optical axis that counts: our models end before 90 degrees."""


def model_of(name: str) -> str | None:
    """The model of `MODELS` that a name means, however it is written; None if none is."""
    plain = name.strip().lower().removeprefix("distortion.")
    if plain in MODELS:
        return MODELS[plain]
    plain = plain.replace("-", "_").replace(" ", "_").removeprefix("pinhole_")
    return MODELS.get(plain, _ALSO.get(plain))


def _middle(x: float, y: float, size: Sequence[float]) -> float:
    """How far a point is from the picture's middle, as a share of the size."""
    return max(abs(x / size[0] - 0.5), abs(y / size[1] - 0.5))


def _told_first(size: Sequence[float], numbers: Sequence[float]) -> bool:
    """Whether the first two numbers are a centre, and the others focal lengths, which are alike."""
    a, b, c, d = numbers
    alike = max(c / d, d / c) < 1.0 + _CENTRED if min(c, d) > 0.0 else False
    off = max(a / b, b / a) > 1.0 + 2.0 * _CENTRED and _middle(c, d, size) > 2.0 * _CENTRED
    return alike and off and _middle(a, b, size) < _CENTRED


def _centre_exchanged(size: Sequence[float], numbers: Sequence[float]) -> bool:
    """Whether the centre is y, x: in the picture's middle so, and not as it is."""
    x, y = numbers[2:]
    return _middle(y, x, size) < _CENTRED and _middle(x, y, size) > 2.0 * _CENTRED


def check_picture(size: Sequence[float], intrinsics: Sequence[float], where: str) -> tuple[int, int]:
    """(width, height) of a picture, with its fx, fy, cx, cy held against it.

    Raises
    ------
    DataError
        If the size is none, the focal lengths are not in pixels or too different, or the centre lies outside.
    """
    width, height = size
    fx, fy, cx, cy = intrinsics
    if min(size) < 1 or any(s != int(s) for s in size):
        raise DataError(f"{where} is for pictures of {width:g} x {height:g}; give whole pixels.")
    if not (min(fx, fy) > 0.0 and max(fx / fy, fy / fx) <= _MOST_RATIO):
        raise DataError(f"{where} has fx {fx:g} and fy {fy:g}, which no camera has; give both in pixels.")
    exchanged = max(abs(fx / cx - 1.0), abs(fy / width - 0.5), abs(cy / height - 0.5)) < _ALIKE
    if exchanged and max(fx / fy, fy / fx) > 1.0 + _ALIKE:
        raise DataError(
            f"{where} has {fx:g}, {fy:g}, {cx:g}, {cy:g}, which looks like fx, cx, fy, cy; give fx, fy, cx, "
            "cy."
        )
    if _told_first(size, intrinsics) or _centre_exchanged(size, intrinsics):
        order = "cx, cy, fx, fy" if _told_first(size, intrinsics) else "fx, fy, cy, cx"
        raise DataError(
            f"{where} has {fx:g}, {fy:g}, {cx:g}, {cy:g}, which looks like {order}; give fx, fy, cx, cy."
        )
    if max(fx, fy) < _LEAST_FOCAL * max(size):
        raise DataError(
            f"{where} has a focal length of {fx:g} for {width:g} x {height:g}; give it in pixels (times the "
            "width, if it is a share of it)."
        )
    if not (0.0 < cx < width and 0.0 < cy < height):
        raise DataError(
            f"{where} has its centre at {cx:g}, {cy:g}, outside of its pictures of {width:g} x {height:g}; "
            "correct it, or the size."
        )
    return int(width), int(height)


def of_matrix(k: Sequence[float], where: str) -> list[float]:
    """fx, fy, cx, cy of a 3x3 matrix K, row by row; DataError if it is none."""
    fx, skew, cx, below, fy, cy, *last = k
    if last != [0.0, 0.0, 1.0] or below != 0.0:
        raise DataError(
            f"The last row of the 3x3 matrix in {where} is not 0 0 1; give K row by row (MATLAB's is "
            "transposed)."
        )
    if abs(skew) > 1e-3 * abs(fx):
        raise DataError(f"The 3x3 matrix in {where} has a skew of {skew:g}; calibrate without one.")
    return [fx, fy, cx, cy]


def lens(
    model: str,
    size: Sequence[float],
    intrinsics: Sequence[float],
    coefficients: Sequence[float],
    where: str,
) -> Camera:
    """The camera of numbers that were read.

    Parameters
    ----------
    model : str
        One of `MODELS`, or ``omni``, in any case.
    size : (width, height)
    intrinsics : sequence of float
        fx, fy, cx, cy, pixels; before them xi, alpha of ``ds``, alpha, beta of ``eucm``, xi of ``omni``.
    coefficients : sequence of float
        Of the distortion; zeros beyond those that the model has are passed over.
    where : str
        The file or message, for messages.

    Raises
    ------
    DataError
        If the model is not known or lacks its coefficients, or numbers are not a camera's.
    """
    name = model.strip().lower()
    if name.removeprefix("distortion.").replace(" ", "_") == _INVERSE and not any(coefficients):
        model, name, coefficients = "none", "none", []
    kind = "omni" if name == "omni" else model_of(name)
    if kind is None:
        known = ", ".join(sorted({"omni", *MODELS} - {""}))
        raise DataError(
            f"The distortion model '{model}' of {where} is not supported; calibrate with one of: {known}."
        )
    width, height = check_picture(size, intrinsics[-4:], where)
    if kind in _RAYS:
        return _carried(kind, (width, height), intrinsics, coefficients, where)
    given = list(coefficients)
    if len(given) >= _DECIMALS and any(given) and all(c == int(c) for c in given):
        raise DataError(f"The distortion of {where} is whole numbers; write decimal points (no commas).")
    while given and given[-1] == 0.0 and len(given) not in COUNTS[kind]:
        given.pop()
    if kind == "radtan" and len(given) == 8 and not any(given[5:]):
        given = given[:5]
    if len(given) not in COUNTS[kind]:
        expected = " or ".join(map(str, COUNTS[kind]))
        raise DataError(
            f"The lens of {where} is '{model}' and has {len(coefficients)} numbers of distortion; {expected} "
            "are needed."
        )
    try:
        return Camera(kind, width, height, intrinsics, given)
    except (ValueError, OverflowError) as error:
        raise DataError(f"The calibration {where} is not usable: {error}") from error


def _double_sphere(m: Array, xi: float, alpha: float) -> Array:
    r2 = np.sum(m**2, axis=1)
    z = (1.0 - alpha**2 * r2) / (alpha * np.sqrt(1.0 - (2.0 * alpha - 1.0) * r2) + 1.0 - alpha)
    length = (z * xi + np.sqrt(z**2 + (1.0 - xi**2) * r2)) / (z**2 + r2)
    return np.column_stack([length[:, None] * m, length * z - xi])


def _extended_unified(m: Array, alpha: float, beta: float) -> Array:
    r2 = beta * np.sum(m**2, axis=1)
    z = (1.0 - alpha**2 * r2) / (alpha * np.sqrt(1.0 - (2.0 * alpha - 1.0) * r2) + 1.0 - alpha)
    return np.column_stack([m, z])


def _omnidirectional(m: Array, xi: float) -> Array:
    r2 = np.sum(m**2, axis=1)
    length = (xi + np.sqrt(1.0 + (1.0 - xi**2) * r2)) / (1.0 + r2)
    return np.column_stack([length[:, None] * m, length - xi])


def _field_of_view(m: Array, omega: float) -> Array:
    r = np.maximum(np.linalg.norm(m, axis=1), 1e-12)
    return np.column_stack(
        [m * (np.tan(r * omega) / (2.0 * r * np.tan(omega / 2.0)))[:, None], np.ones(len(m))]
    )


_RAYS: dict[str, Callable[..., Array]] = {
    "ds": _double_sphere,
    "eucm": _extended_unified,
    "omni": _omnidirectional,
    "fov": _field_of_view,
}
"""Rays of points on the normalised plane, by the parameters of each lens that is carried to a fisheye."""


def _carried(
    kind: str, size: tuple[int, int], intrinsics: Sequence[float], coefficients: Sequence[float], where: str
) -> Camera:
    """The fisheye whose pixels of a lens's rays are nearest to the lens's own, all over the picture."""
    *own, fx, fy, cx, cy = intrinsics
    across, down = (np.linspace(0.0, n - 1.0, 33) for n in size)
    uv = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    if kind == "fov":
        own, coefficients = list(coefficients), []
    inner = lens("radtan" if any(coefficients) else "pinhole", size, (fx, fy, cx, cy), coefficients, where)
    plane = inner.unproject(uv)
    plane = plane[:, :2] / plane[:, 2:]
    try:
        with np.errstate(invalid="ignore", divide="ignore"):
            rays = _RAYS[kind](plane, *own)
    except TypeError:
        raise DataError(
            f"The lens '{kind}' of {where} has {len(own)} parameters, not its own number."
        ) from None
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    seen = np.isfinite(rays).all(axis=1) & (rays[:, 2] > _STEEPEST)
    if seen.sum() < 20:
        raise DataError(f"The lens '{kind}' of {where} has no rays in its picture; correct its parameters.")
    rays, uv = rays[seen], uv[seen]
    theta = np.arccos(np.clip(rays[:, 2], -1.0, 1.0))
    sine = np.maximum(np.linalg.norm(rays[:, :2], axis=1), 1e-12)
    terms = (theta / sine)[:, None] * theta[:, None] ** (2 * np.arange(5))
    rows = np.concatenate([rays[:, :1] * terms, rays[:, 1:2] * terms])
    target = ((uv - (cx, cy)) / (fx, fy)).T.ravel()
    scale, *ks = np.linalg.lstsq(rows, target, rcond=None)[0].tolist()
    try:
        camera = Camera("fisheye", *size, (scale * fx, scale * fy, cx, cy), [k / scale for k in ks])
    except (ValueError, OverflowError) as error:
        raise DataError(f"The calibration {where} is not usable: {error}") from error
    apart = float(np.nan_to_num(np.linalg.norm(camera.project(rays).uv - uv, axis=1), nan=np.inf).max())
    if apart > _MOST_APART:
        raise DataError(
            f"The lens '{kind}' of {where} is up to {apart:.1f} px off the nearest fisheye (equidistant); "
            "calibrate it as pinhole with the distortion model equidistant."
        )
    tell(f"lens '{kind}'", f"as a fisheye, at most {apart:.2f} px off", where)
    return camera

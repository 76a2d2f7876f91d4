"""Lenses in files without keys: COLMAP's ``cameras.txt``, ARKitScenes' ``.pincam``, DSO's and LSD-SLAM's."""

from __future__ import annotations

from pathlib import Path

from collabslam._core import Camera
from collabslam.datasets.gate import another_report, data_lines, is_number, tell, text_of
from collabslam.datasets.lens import lens
from collabslam.errors import DataError

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


_DSO = {
    "pinhole": "none", "radtan": "radtan", "equidistant": "fisheye", "kannalabrandt": "fisheye",
    "fov": "fov", "atan": "fov",
}  # fmt: skip
"""Names that DSO's files may begin with; without one five numbers are a field-of-view lens, eight radtan."""


def camera_of_lines(path: Path) -> Camera:
    """A camera without keys.

    Raises
    ------
    DataError
        If the file is none that is known, or has not the numbers of its model.
    """
    lines = [fields for _, fields in data_lines(path)]
    first = lines[0] if lines else []
    try:
        if len(first) > 4 and first[1].isupper():
            return _colmap(lines, path)
        if len(lines) in (2, 3, 4) and len(lines[1]) == 2:
            return _dso(lines, path)
        if len(lines) == 1 and len(first) == 6:
            numbers = [float(v) for v in first]
            tell("width height fx fy cx cy", numbers, path)
            return lens("none", numbers[:2], numbers[2:], [], str(path))
    except DataError:
        raise
    except ValueError as error:
        raise DataError(
            f"The calibration {path} has not the numbers of its model ({error}); correct it."
        ) from error
    if len(lines) in (3, 4) and all(len(fields) == len(lines) for fields in lines):
        raise DataError(
            f"{path} is a matrix and does not say the size of its pictures; write it in YAML: camera_matrix, "
            "image_width, image_height, distortion_coefficients."
        )
    said = another_report(text_of(path)) or (
        "holds no 'key: value' lines, nor a single camera of COLMAP's cameras.txt, nor one of DSO; give a "
        "calibration in YAML"
    )
    raise DataError(f"The file {path} {said}.")


def _colmap(lines: list[list[str]], path: Path) -> Camera:
    """COLMAP's ``cameras.txt``, whose pixels begin at their corners."""
    kind = lines[0][1]
    if len(lines) > 1:
        raise DataError(f"{path} has {len(lines)} cameras; give a file of one, that of these images.")
    if kind not in _COLMAP:
        raise DataError(f"COLMAP's model {kind} of {path} is not read; one of {', '.join(_COLMAP)} is.")
    model, names = _COLMAP[kind]
    size, numbers = [float(v) for v in lines[0][2:4]], [float(v) for v in lines[0][4:]]
    told = dict(zip(names.split(), numbers, strict=True))
    f = told.get("f", 0.0)
    intrinsics = [told.get("fx", f), told.get("fy", f), told["cx"] - 0.5, told["cy"] - 0.5]
    coefficients = [told.get(name, 0.0) for name in _ORDER[model].split()]
    tell(f"COLMAP's {kind}", numbers, path)
    return lens(model, size, intrinsics, coefficients, str(path))


def _dso(lines: list[list[str]], path: Path) -> Camera:
    """The raw lens of LSD-SLAM's and DSO's ``camera.txt``; in pixels, or in shares of the picture."""
    named = not is_number(lines[0][0])
    numbers = [float(v) for v in lines[0][named:]]
    (width, height) = size = [float(v) for v in lines[1]]
    model = _DSO.get(lines[0][0].lower(), "") if named else {5: "fov", 8: "radtan"}.get(len(numbers), "")
    if not model or len(numbers) < 4:
        raise DataError(f"The lens of {path} is none of DSO's ({', '.join(_DSO)}); correct its first line.")
    fx, fy, cx, cy, *coefficients = numbers
    if max(cx, cy) < 1.0:
        fx, fy, cx, cy = fx * width, fy * height, cx * width - 0.5, cy * height - 0.5
    if model == "fov" and not any(coefficients):
        model = "none"
    tell("lens as DSO has it", numbers, path)
    if len(lines) > 2:
        tell("passed over", "line 3 and what follows (of rectified pictures)", path)
    return lens(model, size, [fx, fy, cx, cy], coefficients if any(coefficients) else [], str(path))

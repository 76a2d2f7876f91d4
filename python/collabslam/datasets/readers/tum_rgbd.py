"""TUM RGB-D: ``rgb.txt`` (stamp, image), ``groundtruth.txt`` (poses of the colour camera).

The calibration is that of the sensor whose name the folder carries (``freiburg1``, ``2`` or ``3``), or is
given with ``--camera FILE``.  Depth images (``depth.txt``, 16 bits, 5000 a metre, registered to the colour
images) go with the nearest colour image within 20 ms; ``--depth-scale`` says other counts a metre.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.calibration import of_stamped, read_calibration
from collabslam.datasets.depth_image import TUM, DepthImage, depth_scale
from collabslam.datasets.gate import data_lines, leave_columns, tell
from collabslam.datasets.images import named_file, require_files
from collabslam.datasets.overrides import Given
from collabslam.datasets.poses import interpolate_track, read_track
from collabslam.datasets.recording import ImageRecording
from collabslam.datasets.units import as_seconds, read_stamps
from collabslam.errors import DataError
from collabslam.types import Array

_TOGETHER = 0.02
LAYOUT = "TUM RGB-D (rgb.txt, rgb/, groundtruth.txt)"
_SENSORS = {
    "1": ((517.3, 516.5, 318.6, 255.3), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    "2": ((520.9, 521.0, 325.1, 249.7), (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    "3": ((535.4, 539.2, 320.1, 247.6), ()),
}


def matches(path: Path) -> bool:
    """Whether ``path`` is a TUM RGB-D sequence."""
    return (path / "rgb.txt").is_file()


def open(path: Path, given: Given) -> ImageRecording:
    """Open a TUM RGB-D sequence."""
    times, paths = _images(path, "rgb.txt")
    truth = path / "groundtruth.txt"
    own = None if given.camera is None else of_stamped(read_calibration(given.camera), given.camera)
    depth = None
    if (path / "depth.txt").is_file():
        stated = None if own is None else own.depth_scale
        depth = _depths(path, times, depth_scale(given.depth_scale, stated, TUM, str(path / "depth.txt")))
    return ImageRecording(
        name=path.name,
        source=str(path),
        camera=_sensor(path) if own is None else own.camera,
        paths=tuple(paths),
        times=times,
        truth=interpolate_track(*read_track(truth), times) if truth.is_file() else None,
        depth=depth,
    )


def _images(path: Path, name: str) -> tuple[Array, list[Path]]:
    """Stamps and files of a list of images."""
    listing = path / name
    rows = data_lines(listing)
    short = next((n for n, fields in rows if len(fields) < 2), None)
    if short is not None:
        raise DataError(f"Line {short} of {listing} needs two columns: the stamp in seconds, the image file.")
    leave_columns((fields for _, fields in rows), 2, listing)
    paths = [named_file(path, fields[1], f"line {n} of {listing}") for n, fields in rows]
    require_files(paths)
    texts, lines = [fields[0] for _, fields in rows], [n for n, _ in rows]
    return as_seconds(read_stamps(texts, str(listing), lines=lines)), paths


def _depths(path: Path, times: Array, per_metre: float) -> dict[int, DepthImage]:
    stamps, paths = _images(path, "depth.txt")
    if not len(stamps):
        return {}
    nearest = np.argmin(np.abs(stamps[None] - times[:, None]), axis=1)
    gaps = stamps[nearest] - times
    near = np.flatnonzero(np.abs(gaps) <= _TOGETHER).tolist()
    return {i: DepthImage(paths[nearest[i]], per_metre, float(gaps[i])) for i in near}


def _sensor(path: Path) -> Camera:
    found = re.search(r"(?:freiburg|fr)_?([123])", path.name)
    if found is None:
        raise DataError(
            f"The folder's name {path.name} does not tell the sensor (freiburg1, 2 or 3); give --camera "
            "FILE ('collabslam init --board' makes one)."
        )
    intrinsics, distortion = _SENSORS[found.group(1)]
    tell("camera", f"the benchmark's of freiburg{found.group(1)}", f"the folder's name {path.name}")
    return Camera("radtan" if distortion else "pinhole", 640, 480, intrinsics, distortion)

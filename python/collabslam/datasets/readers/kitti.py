"""KITTI stereo: ``image_l``, ``image_r``, ``calib.txt`` (two 3x4 projections), ``poses.txt`` (3x4), 10 Hz.

The left camera is Cs; the right one is the rig's second camera.  The odometry benchmark's own layout is read
too: ``sequences/00`` with ``image_0`` and ``image_1`` (or the colour pair ``image_2`` and ``image_3``),
``calib.txt`` with the lines ``P0:`` to ``P3:``, ``times.txt``, and ``poses/00.txt`` two folders up.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.calibration import pinhole_camera
from collabslam.datasets.gate import data_lines, leave_columns, tell
from collabslam.datasets.images import image_size, list_images
from collabslam.datasets.poses import number_fields, read_pose_rows
from collabslam.datasets.recording import ImageRecording, Rig, times_at_rate
from collabslam.datasets.units import as_seconds, read_stamps
from collabslam.errors import DataError
from collabslam.geometry import pose, pose_inverse
from collabslam.types import Array

LAYOUT = "KITTI stereo (image_l, image_r, or image_0, image_1, with calib.txt)"
RATE = 10.0
_FOLDERS = (("image_l", "image_r", 0), ("image_0", "image_1", 0), ("image_2", "image_3", 2))
"""Left and right images, and which projection of ``calib.txt`` is the left one's."""


def _folders(path: Path) -> tuple[Path, Path, int] | None:
    for left, right, first in _FOLDERS:
        if (path / left).is_dir():
            return path / left, path / right, first
    return None


def matches(path: Path) -> bool:
    """Whether ``path`` is a KITTI sequence."""
    return _folders(path) is not None and (path / "calib.txt").is_file()


def _projections(path: Path, first: int) -> list[Array]:
    """Two 3x4 projections of ``calib.txt`` from the given one on; a lidar's line (``Tr:``) is not one."""
    out: list[Array] = []
    for number, fields in data_lines(path):
        if fields[0].endswith(":"):
            if not fields[0].startswith("P"):
                tell("passed over", f"{fields[0]} (no camera's projection)", path)
                continue
            fields = fields[1:]
        values = number_fields(fields, f"Line {number} of {path}")
        if len(values) != 12:
            raise DataError(
                f"Line {number} of {path} has {len(values)} numbers; a projection is 3x4 = 12 numbers."
            )
        out.append(np.asarray(values).reshape(3, 4))
    if len(out) < first + 2:
        raise DataError(
            f"The calibration {path} has {len(out)} projections; give the left and the right camera's."
        )
    return out[first : first + 2]


def _split(projection: Array, size: tuple[int, int], path: Path) -> tuple[Camera, Array]:
    """Camera of a projection K [I | t], and t: the reference camera's origin in this camera, metres."""
    k = projection[:, :3]
    camera = pinhole_camera(k, size, path)
    return camera, np.asarray(np.linalg.solve(k, projection[:, 3]), dtype=np.float64)


def _times(path: Path, images: list[Path]) -> Array:
    stamps = path / "times.txt"
    if not stamps.is_file():
        return times_at_rate(images, RATE)
    rows = data_lines(stamps)
    leave_columns((fields for _, fields in rows), 1, stamps)
    return as_seconds(read_stamps([f[0] for _, f in rows], str(stamps), lines=[n for n, _ in rows]))


def _benchmark_poses(path: Path) -> Path:
    """Where the odometry benchmark keeps the poses of ``sequences/00``."""
    return path.parent.parent / "poses" / f"{path.name}.txt"


def open(path: Path) -> ImageRecording:
    """Open a KITTI sequence."""
    folders = _folders(path)
    if folders is None:
        raise DataError(f"{path} has no folder image_l; give the folder of one KITTI sequence.")
    left, right = (list_images(folders[0]), list_images(folders[1]) if folders[1].is_dir() else [])
    size = image_size(left[0])
    calib = path / "calib.txt"
    p_left, p_right = _projections(calib, folders[2])
    camera, t_left = _split(p_left, size, calib)
    second, t_right = _split(p_right, size, calib)
    truth = None
    poses = next((f for f in (path / "poses.txt", _benchmark_poses(path)) if f.is_file()), None)
    if poses is not None:
        # Poses are the reference camera's: x_left = x_reference + t_left.
        truth = read_pose_rows(poses) @ pose_inverse(pose(np.eye(3), t_left))
    index = {p.stem: k for k, p in enumerate(left)}
    pairs = {index[p.stem]: p for p in right if p.stem in index}
    return ImageRecording(
        name=path.name,
        source=str(path),
        camera=camera,
        paths=tuple(left),
        times=_times(path, left),
        truth=truth,
        rig=Rig(second, pose(np.eye(3), t_left - t_right), pairs) if pairs else None,
    )

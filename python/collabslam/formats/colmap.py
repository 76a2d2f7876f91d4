"""Poses and map as a COLMAP model, binary or text: cameras, images, points3D.

Frames: COLMAP's poses map points of the world into the camera, quaternion scalar first.  The points have no
tracks: a result folder does not keep which pixels they were seen at.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.formats.files import write_bytes, write_text
from collabslam.formats.lens_names import lens_of
from collabslam.formats.trajectory import position_quaternion
from collabslam.geometry import pose_inverse
from collabslam.results import Landmarks
from collabslam.types import Array

_MODELS = {"PINHOLE": 1, "OPENCV": 4, "OPENCV_FISHEYE": 5, "FULL_OPENCV": 6}
_CAMERA = 1
GREY = 128
"""Of all colours of all points, which have none of their own."""
NO_ERROR = -1.0
"""COLMAP's own for a point whose reprojection error is not known."""


def write_colmap(
    folder: Path, camera: Camera, names: Sequence[str], poses: Array, points: Landmarks, *, text: bool
) -> None:
    """Write a model.

    Parameters
    ----------
    folder : Path
        Of the three files.
    camera : Camera
        Cs, with its distortion.
    names : sequence of str
        Of the N images.
    poses : (N, 4, 4) array
        ``T_WC``, metres.
    points : Landmarks
        In W, metres.
    text : bool
        ``.txt`` in place of ``.bin``.

    Raises
    ------
    DataError
        If COLMAP does not know the lens, or a file cannot be written.
    """
    model, numbers = lens_of(camera)
    views = [(name, _world_to_camera(pose)) for name, pose in zip(names, poses, strict=True)]
    if text:
        values = " ".join(f"{v!r}" for v in numbers.values())
        write_text(folder / "cameras.txt", f"{_CAMERA} {model} {camera.width} {camera.height} {values}\n")
        lines = (
            f"{k} {' '.join(f'{v:.12g}' for v in pose)} {_CAMERA} {name}\n\n"
            for k, (name, pose) in enumerate(views, 1)
        )
        write_text(folder / "images.txt", "".join(lines))
        rows = zip(points.ids, points.points, strict=True)
        colour = f"{GREY} {GREY} {GREY} {NO_ERROR:g}"
        write_text(
            folder / "points3D.txt",
            "".join(f"{k + 1} {x:.9g} {y:.9g} {z:.9g} {colour}\n" for k, (x, y, z) in rows),
        )
        return
    head = struct.pack("<QiiQQ", 1, _CAMERA, _MODELS[model], camera.width, camera.height)
    write_bytes(folder / "cameras.bin", head + struct.pack(f"<{len(numbers)}d", *numbers.values()))
    parts = [struct.pack("<Q", len(views))]
    for k, (name, pose) in enumerate(views, 1):
        parts.append(struct.pack("<i7di", k, *pose, _CAMERA) + name.encode() + b"\0" + struct.pack("<Q", 0))
    write_bytes(folder / "images.bin", b"".join(parts))
    parts = [struct.pack("<Q", len(points.ids))]
    for k, point in zip(points.ids, points.points, strict=True):
        parts.append(struct.pack("<Q3d3BdQ", int(k) + 1, *point, GREY, GREY, GREY, NO_ERROR, 0))
    write_bytes(folder / "points3D.bin", b"".join(parts))


def _world_to_camera(t_wc: Array) -> list[float]:
    """``qw qx qy qz tx ty tz`` of the inverse."""
    x, y, z, qx, qy, qz, qw = position_quaternion(np.asarray(pose_inverse(t_wc)))
    return [qw, qx, qy, qz, x, y, z]

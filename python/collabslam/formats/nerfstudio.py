"""Poses and map as nerfstudio's ``transforms.json`` and the cloud that it names."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.errors import DataError
from collabslam.formats.colmap import GREY
from collabslam.formats.files import write_bytes, write_text
from collabslam.formats.lens_names import lens_of
from collabslam.results import Landmarks
from collabslam.types import Array

_TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
CLOUD = "sparse.ply"


def write_transforms(
    folder: Path, camera: Camera, names: Sequence[str], poses: Array, points: Landmarks
) -> None:
    """Write ``transforms.json`` and ``sparse.ply``.

    Parameters
    ----------
    folder : Path
        Of both, and of the images that ``names`` are relative to.
    camera : Camera
        Cs, with its distortion.
    names : sequence of str
        Of the N images.
    poses : (N, 4, 4) array
        ``T_WC``, metres; they are written with OpenGL's camera axes (x right, y up, z back).
    points : Landmarks
        In W, metres.

    Raises
    ------
    DataError
        If nerfstudio does not know the lens, or a file cannot be written.
    """
    model, numbers = lens_of(camera)
    if any(numbers.get(name) for name in ("k4", "k5", "k6")) and model == "FULL_OPENCV":
        raise DataError("nerfstudio knows no rational lens; take COLMAP's format, or undistort the images.")
    given: dict[str, object] = {
        name: numbers[name] for name in ("k1", "k2", "k3", "k4", "p1", "p2") if name in numbers
    }
    content: dict[str, object] = {
        "camera_model": "OPENCV_FISHEYE" if model == "OPENCV_FISHEYE" else "OPENCV",
        "w": camera.width,
        "h": camera.height,
        "fl_x": numbers["fx"],
        "fl_y": numbers["fy"],
        "cx": numbers["cx"],
        "cy": numbers["cy"],
        **given,
        "ply_file_path": CLOUD,
        "frames": [
            {"file_path": name, "transform_matrix": (pose @ _TO_OPENGL).tolist()}
            for name, pose in zip(names, poses, strict=True)
        ],
    }
    write_text(folder / "transforms.json", json.dumps(content, indent=1) + "\n")
    _write_cloud(folder / CLOUD, points)


def _write_cloud(path: Path, points: Landmarks) -> None:
    """A PLY of float32 positions and grey colours, as readers of splats want it."""
    axes, colours = ("x", "y", "z"), ("red", "green", "blue")
    table = np.empty(len(points.ids), [*((a, "<f4") for a in axes), *((c, "u1") for c in colours)])
    for k, axis in enumerate(axes):
        table[axis] = points.points[:, k]
    for colour in colours:
        table[colour] = GREY
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    head += [f"property float {a}" for a in axes] + [f"property uchar {c}" for c in colours] + ["end_header"]
    write_bytes(path, ("\n".join(head) + "\n").encode() + table.tobytes())

"""Posed images: ``images/``, ``K.txt`` (3x3) and ``poses.txt`` (one 4x4 camera-to-world matrix a line).

The images are undistorted and 10 Hz; numbers in their names count frames, so that missing images leave gaps
in time.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam.datasets.calibration import pinhole_camera
from collabslam.datasets.gate import data_lines
from collabslam.datasets.images import image_size, list_images
from collabslam.datasets.poses import number_fields, read_pose_rows
from collabslam.datasets.recording import ImageRecording, times_at_rate
from collabslam.errors import DataError

LAYOUT = "posed images (images/, K.txt, poses.txt)"
RATE = 10.0


def matches(path: Path) -> bool:
    """Whether ``path`` holds posed images."""
    return (path / "images").is_dir() and (path / "K.txt").is_file() and (path / "poses.txt").is_file()


def open(path: Path) -> ImageRecording:
    """Open a folder of posed images."""
    paths = list_images(path / "images")
    k_file = path / "K.txt"
    k = number_fields((f for _, fields in data_lines(k_file) for f in fields), f"The calibration {k_file}")
    if len(k) != 9:
        raise DataError(f"The calibration {k_file} has {len(k)} numbers; K is 3x3 = 9 numbers, row by row.")
    return ImageRecording(
        name=path.name,
        source=str(path),
        camera=pinhole_camera(np.asarray(k).reshape(3, 3), image_size(paths[0]), k_file),
        paths=tuple(paths),
        times=times_at_rate(paths, RATE),
        truth=read_pose_rows(path / "poses.txt"),
    )

"""7-Scenes: ``frame-*.color.{jpg,png}`` with ``frame-*.pose.txt`` (4x4, camera to world, metres).

The frames are 30 Hz.  The calibration is that of the colour camera, f = 520 and c = (320, 240) without
distortion; a ``camera-intrinsics.txt`` beside the frames belongs to the depth camera and is not used.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.gate import data_lines, tell
from collabslam.datasets.image_names import natural
from collabslam.datasets.poses import number_fields, rigid
from collabslam.datasets.recording import ImageRecording, times_at_rate
from collabslam.errors import DataError
from collabslam.types import Array

LAYOUT = "7-Scenes (frame-*.color.jpg or .png with frame-*.pose.txt)"
RATE = 30.0
_SIZE = (640, 480)
_INTRINSICS = (520.0, 520.0, 320.0, 240.0)


def _frames(path: Path) -> list[Path]:
    return sorted((p for p in path.glob("frame-*.color.*") if p.suffix in (".jpg", ".png")), key=natural)


def matches(path: Path) -> bool:
    """Whether ``path`` is a 7-Scenes sequence."""
    return bool(_frames(path))


def _read_pose(path: Path) -> Array:
    numbers = number_fields((f for _, fields in data_lines(path) for f in fields), f"The pose file {path}")
    if len(numbers) != 16:
        raise DataError(f"The pose file {path} has {len(numbers)} numbers; a pose is 4x4 = 16 numbers.")
    return rigid(np.asarray(numbers).reshape(4, 4), f"The pose in {path}")


def open(path: Path) -> ImageRecording:
    """Open a 7-Scenes sequence; frames without a pose, or with one that is not finite, have no truth."""
    paths = _frames(path)
    truth = np.full((len(paths), 4, 4), np.nan)
    for k, image in enumerate(paths):
        pose_file = image.with_name(image.name.split(".")[0] + ".pose.txt")
        if pose_file.is_file():
            truth[k] = _read_pose(pose_file)
    known = bool(np.any(np.isfinite(truth)))
    tell("camera", "the data set's colour camera", "the layout")
    tell("poses", f"{int(np.isfinite(truth).all(axis=(1, 2)).sum())} of {len(paths)} frames", path)
    return ImageRecording(
        name=path.name,
        source=str(path),
        camera=Camera("pinhole", *_SIZE, _INTRINSICS, []),
        paths=tuple(paths),
        times=times_at_rate(paths, RATE),
        truth=truth if known else None,
    )

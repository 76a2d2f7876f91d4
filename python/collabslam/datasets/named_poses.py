"""Poses that are of images by name: COLMAP's ``images.txt`` and nerfstudio's ``transforms.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from collabslam.datasets.gate import Keys, data_lines, is_number, tell
from collabslam.errors import DataError
from collabslam.geometry import pose_from_quaternion, pose_inverse
from collabslam.types import Array

_COLUMNS = 10
"""Of an image in COLMAP's file; the line after it has three for each of its points."""


def is_colmap(lines: Sequence[tuple[int, list[str]]]) -> bool:
    """Whether lines are those of COLMAP's ``images.txt``."""
    return bool(lines) and len(lines[0][1]) == _COLUMNS and not is_number(lines[0][1][-1])


def colmap_poses(path: Path, names: Sequence[str]) -> Array:
    """``T_WC`` of frames by the names of their images, (N, 4, 4), NaN where the file has none; see `_of`."""
    known: dict[str, Array] = {}
    for number, fields in data_lines(path):
        if len(fields) != _COLUMNS:
            continue
        try:
            values = np.array([float(text) for text in fields[1:8]])
        except ValueError:
            values = np.full(7, np.nan)
        if not np.isfinite(values).all() or abs(float(np.linalg.norm(values[:4])) - 1.0) > 1e-2:
            raise DataError(
                f"Line {number} of {path} holds no pose with a unit quaternion; give COLMAP's images.txt as "
                "it was written."
            )
        known[fields[-1]] = pose_inverse(pose_from_quaternion(values[4:], values[:4]))
    tell("unit of the poses", "COLMAP's own, not metres unless it was told them", path)
    return _of(known, names, path)


def nerfstudio_poses(keys: Keys, path: Path, names: Sequence[str]) -> Array:
    """The same of the ``frames`` of a ``transforms.json``, along the axes that it has; see `_of`."""
    known: dict[str, Array] = {}
    for k, frame in enumerate(keys.need("frames")):
        where = f"Frame {k} of {path}"
        matrix = frame.get("transform_matrix") if isinstance(frame, dict) else None
        try:
            pose = np.asarray(matrix, np.float64)
            name = str(frame["file_path"])
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f"{where} has no file_path with a transform_matrix; give both.") from error
        if pose.shape != (4, 4):
            raise DataError(f"{where} has a transform_matrix of shape {pose.shape}; 4x4 is needed.")
        known[name] = pose
    keys.leave("*", why="of the camera")
    return _of(known, names, path)


def _of(known: Mapping[str, Array], names: Sequence[str], path: Path) -> Array:
    """Poses by whole names of files, or without their endings, as some write them.

    Raises
    ------
    DataError
        If the frames are no files of images, or the file knows none of them.
    """
    if not names:
        raise DataError(f"{path} has poses of images by name, and this recording's images are no files.")
    by_name = {PurePosixPath(name).name: pose for name, pose in known.items()}
    by_name |= {PurePosixPath(name).stem: pose for name, pose in known.items()}
    nothing = np.full((4, 4), np.nan)
    out = [by_name.get(name, by_name.get(PurePosixPath(name).stem, nothing)) for name in names]
    found = sum(bool(np.isfinite(pose).all()) for pose in out)
    if not found:
        raise DataError(
            f"{path} has poses of {', '.join(list(by_name)[:2]) or 'no image'}, none of this recording's "
            f"images ({names[0]}, ..); give those of these images."
        )
    tell("poses", f"{found} of {len(names)} frames, by the names of their images", path)
    return np.asarray(out)

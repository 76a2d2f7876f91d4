"""Davison's MonoSLAM test sequence in SceneLib2's layout, with its known target.

``frames/*.pgm``, ``cameras/*.json`` (wide-angle model), ``init/*.json`` (start state, four known points) and
``init/known_patch*.pgm``.  The frames are 30 Hz; the ``fps`` of the camera file is not the sequence's.

SceneLib's camera axes are x left, y up, z forward; they are turned to x right, y down here (half a turn about
z).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam.datasets.calibration import load_camera
from collabslam.datasets.gate import read_keys
from collabslam.datasets.images import decode_grey, list_images
from collabslam.datasets.recording import ImageRecording, times_at_rate
from collabslam.errors import CollabslamError, DataError
from collabslam.geometry import pose, pose_from_quaternion
from collabslam.types import Array, Target

LAYOUT = "SceneLib2 (frames/*.pgm, cameras/*.json, init/*.json)"
RATE = 30.0
_TURN = pose(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))


def matches(path: Path) -> bool:
    """Whether ``path`` is a SceneLib2 sequence."""
    return any((path / "frames").glob("*.pgm")) and any((path / "init").glob("*.json"))


def _start_covariance(pxx: Array, q: Array, rotation: Array) -> Array:
    """6x6 tangent covariance of the start pose from that of (position, quaternion).

    With dq = q (x) (0, w / 2), w = 2 E^T dq; the position's part is turned into the camera's axes.
    """
    w, x, y, z = q
    e = np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]])
    j = np.zeros((6, 7))
    j[:3, :3] = rotation.T
    j[3:, 3:] = 2.0 * _TURN[:3, :3].T @ e.T
    return np.asarray(j @ pxx @ j.T, dtype=np.float64)


def _target(folder: Path, file: Path) -> Target:
    with read_keys(file) as keys:
        state, position, features = keys.need("xv"), keys.need("pxx"), keys.need("features")
        keys.leave("*")
    try:
        xv = np.asarray(state, dtype=np.float64)[:7]
        pxx = np.asarray(position, dtype=np.float64)[:7, :7]
        points = np.asarray([f["yi"] for f in features], dtype=np.float64)
        t_tc = pose_from_quaternion(xv[:3], xv[3:]) @ _TURN
        covariance = _start_covariance(pxx, xv[3:] / np.linalg.norm(xv[3:]), t_tc[:3, :3])
    except KeyError as error:
        raise DataError(f"The start state {file} lacks the key {error}; add it.") from error
    except CollabslamError as error:
        raise DataError(f"The start state {file} is not usable: {error}") from error
    except (TypeError, ValueError, IndexError) as error:
        raise DataError(f"The start state {file} has arrays of the wrong size; restore it.") from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise DataError(f"The features of {file} are not points of three numbers; restore it.")
    patches = [decode_grey(folder / f"known_patch{k}.pgm") for k in range(len(points))]
    return Target(points, patches, t_tc, covariance)


def open(path: Path) -> ImageRecording:
    """Open a SceneLib2 sequence; ``Recording.target`` holds the known points."""
    paths = list_images(path / "frames")
    start = min((path / "init").glob("*.json"))
    calibration = path / "cameras" / start.name
    return ImageRecording(
        name=path.name,
        source=str(path),
        camera=load_camera(calibration),
        paths=tuple(paths),
        times=times_at_rate(paths, RATE),
        target=_target(path / "init", start),
    )

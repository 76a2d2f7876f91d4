"""EuRoC (ASL layout): ``mav0/cam0`` is Cs, ``mav0/cam1`` the rig's second camera.

The truth is ``mav0/state_groundtruth_estimate0/data.csv``, if that is there: poses of the body, composed with
the camera's ``T_BS``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam.datasets.calibration import load_camera, load_extrinsics
from collabslam.datasets.poses import interpolate_track, read_track
from collabslam.datasets.readers.stamped import match_stamps, read_stream
from collabslam.datasets.recording import ImageRecording, Rig
from collabslam.datasets.units import seconds
from collabslam.geometry import pose_inverse
from collabslam.types import Array

LAYOUT = "EuRoC (mav0/cam0/data, mav0/cam0/sensor.yaml)"
_RIG_TOLERANCE = 1_000_000


def _root(path: Path) -> Path:
    return path.parent if path.name == "mav0" else path


def matches(path: Path) -> bool:
    """Whether ``path`` is an EuRoC sequence, or its folder ``mav0``."""
    return (_root(path.absolute()) / "mav0" / "cam0").is_dir()


def _truth(root: Path, times: Array) -> tuple[Array | None, Array | None]:
    """True poses of Cs, and the T_BS by which they were those of the body."""
    body = root / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    if not body.is_file():
        return None, None
    stamps, poses = read_track(body, euroc=True)
    t_bs = load_extrinsics(root / "mav0" / "cam0" / "sensor.yaml")
    return interpolate_track(stamps, poses @ t_bs, times), t_bs


def _rig(root: Path, stamps: list[int]) -> Rig | None:
    first, second = root / "mav0" / "cam0", root / "mav0" / "cam1"
    if not (second / "data").is_dir():
        return None
    others, paths = read_stream(second)
    pairs = match_stamps(stamps, others, _RIG_TOLERANCE)
    t_cf = pose_inverse(load_extrinsics(first / "sensor.yaml")) @ load_extrinsics(second / "sensor.yaml")
    return Rig(load_camera(second / "sensor.yaml"), t_cf, {i: paths[j] for i, j in pairs.items()})


def open(path: Path) -> ImageRecording:
    """Open an EuRoC sequence."""
    root = _root(path.absolute())
    stamps, paths = read_stream(root / "mav0" / "cam0")
    times = np.asarray([seconds(s) for s in stamps])
    truth, t_bs = _truth(root, times)
    return ImageRecording(
        name=root.name,
        source=str(root),
        camera=load_camera(root / "mav0" / "cam0" / "sensor.yaml"),
        paths=tuple(paths),
        times=times,
        truth=truth,
        t_bs=t_bs,
        rig=_rig(root, stamps),
    )

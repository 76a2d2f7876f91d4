"""Broken files for every reader: each is read, or refused with an error of this package.

The files are good ones with damage: bytes flipped, cut, doubled, or replaced by what parsers choke on.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from collabslam.datasets import open_recording
from collabslam.datasets.calibration import load_camera, read_calibration
from collabslam.datasets.images import decode_grey
from collabslam.datasets.poses import read_pose_rows, read_track
from collabslam.datasets.readers.stamped import read_stream
from collabslam.datasets.ros.sensors import read_sensors
from collabslam.datasets.ros.writer import TOPICS
from collabslam.errors import CollabslamError
from collabslam.formats.container import seal
from collabslam.formats.landmarks import read_ply, write_ply
from collabslam.formats.trajectory import read_covariances, write_covariances, write_tum
from collabslam.results import Landmarks
from collabslam.runs.run_folder import read_frames, read_summary
from collabslam.settings.table import Settings
from collabslam.slam.engine import Slam
from collabslam.slam.map.saved_map import SavedMap
from collabslam_lab.benchmark.plan import find_plan
from collabslam_lab.reliability.samples import SmallRecording, bag, engine_state, saved_map

SLOW_S = 10.0
"""A reader that takes more of the processor over a small file hangs."""

TOKENS = (
    b"nan",
    b"inf",
    b"-",
    b"1e999",
    b"9" * 400,
    b"9" * 5000,
    b"\x00",
    b"\xff\xfe",
    b"[" * 3000,
    b"{" * 3000,
    b"{a: " * 500,
    b"!!python/object/apply:os.system [true]",
    b"&a [*a]",
    b"../../etc/passwd",
    b",,,,",
    b'"',
    b"\n\n",
    b"1 2 3",
    b"element vertex 999999999999",
    b"\xe2\x80\xa8",
    b"null",
    b"true",
    b"[]",
    b"{}",
)
"""What parsers choke on."""

Read = Callable[[Path], object]


@dataclass(frozen=True)
class Reader:
    """A reader, and good content of its file.

    Attributes
    ----------
    read : callable
    name : str
        The file's name.
    good : bytes
    sealed : bool
        Whether the file ends with a checksum, which damage is given anew.
    beside : mapping
        Other files of the same folder, not damaged.
    """

    read: Read
    name: str
    good: bytes
    sealed: bool = False
    beside: Mapping[str, bytes] = field(default_factory=dict)


@dataclass
class ReaderFindings:
    """What came of it: inputs tried, read and refused, and what should not have happened."""

    executions: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    findings: list[str] = field(default_factory=list)


def readers() -> dict[str, Reader]:
    """Every reader of a file, by name."""
    return {
        "calibration-euroc": Reader(
            read_calibration,
            "sensor.yaml",
            b"sensor_type: camera\nT_BS:\n  rows: 4\n  cols: 4\n"
            b"  data: [1, 0, 0, 0.1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
            b"resolution: [752, 480]\ncamera_model: pinhole\n"
            b"intrinsics: [458.6, 457.3, 367.2, 248.4]\ndistortion_model: radial-tangential\n"
            b"distortion_coefficients: [-0.28, 0.07, 0.0002, 1.7e-05]\n",
        ),
        "calibration-kalibr": Reader(
            load_camera,
            "camchain.yaml",
            b"cam0:\n  camera_model: pinhole\n  distortion_coeffs: [0.01, -0.02, 0.003, 0.0]\n"
            b"  distortion_model: equidistant\n  intrinsics: [380.1, 380.2, 320.5, 240.5]\n"
            b"  resolution: [640, 480]\n",
        ),
        "calibration-ros": Reader(
            load_camera,
            "camera.yaml",
            b"image_width: 640\nimage_height: 480\ncamera_name: left\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
            b"  data: [500, 0, 320, 0, 500, 240, 0, 0, 1]\ndistortion_model: plumb_bob\n"
            b"distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, 0, 0, 0, 0]\n",
        ),
        "calibration-opencv": Reader(
            load_camera,
            "opencv.yml",
            b"%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n"
            b"   rows: 3\n   cols: 3\n   dt: d\n   data: [ 500., 0., 320., 0., 500., 240., 0., 0., 1. ]\n"
            b"distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n"
            b"   data: [ 0.1, 0., 0., 0., 0. ]\n",
        ),
        "calibration-davison": Reader(
            load_camera,
            "camera.json",
            b'{"model": "wideangle", "width": 320, "height": 240, "focal_length_x": 195, '
            b'"focal_length_y": 195, "principal_point_x": 162, "principal_point_y": 125, '
            b'"radial_distortion_x": 6e-06}',
        ),
        "settings": Reader(
            Settings.load,
            "settings.yaml",
            b"filter:\n  estimator:\n    mode: collab\n  pixel:\n    sigma_cs: 1.5\n  map: {in_view: 30}\n"
            b"frontend:\n  search.min_score: 0.8\n",
        ),
        "worn-sensors": Reader(
            read_sensors,
            "sensors.yaml",
            b"scanners:\n  front: {topic: /scan, ahead: 0.05, left: 0.0, up: -0.65, heading_deg: 0.0}\n"
            b"ahrs:\n  robot: {topic: /imu}\n  worn: {topic: /head/imu}\ncamera_height: 0.95\n"
            b"person:\n  camera_height: 1.7\n  neck_to_camera: [0.0, -0.1, 0.1]\nstart: [0.0, 2.0]\n",
        ),
        "plan": Reader(
            lambda path: find_plan(path.parent, path),
            "plan.yaml",
            b"seeds: 0-4\ndefaults: {available: 0.4}\nrecordings:\n  kitchen:\n    worn: lag:2.0\n"
            b"    noise: [0.03, 0.5, 0.5, 1]\n    modes: [mono, collab]\n"
            b"    settings: {filter.map.in_view: 60}\n"
            b"    reference: {system: other, ate_sim3_pct: 0.94, poses: 476}\n"
            b"ablation:\n  seeds: 0-2\n  levers: {no gate: {filter.validate.conditional_level: 1.0}}\n",
        ),
        "trajectory-tum": Reader(read_track, "poses.tum", _written(lambda path: write_tum(path, _T, _POSES))),
        "trajectory-rows": Reader(read_pose_rows, "poses.txt", b"1 0 0 0.5 0 1 0 0.25 0 0 1 -3e-1\n" * 3),
        "covariances": Reader(
            read_covariances,
            "poses.cov",
            _written(lambda path: write_covariances(path, _T, np.tile(np.eye(6), (3, 1, 1)))),
        ),
        "images-list": Reader(
            lambda path: read_stream(path.parent),
            "data.csv",
            b"#timestamp [ns],filename\n1403636579763555584,a.png\n1403636579813555456,b.png\n",
        ),
        "image-png": Reader(decode_grey, "a.png", _encoded(".png")),
        "image-jpeg": Reader(decode_grey, "a.jpg", _encoded(".jpg")),
        "image-pgm": Reader(decode_grey, "a.pgm", _encoded(".pgm")),
        "map-ply": Reader(read_ply, "map.ply", _written(lambda path: write_ply(path, _LANDMARKS))),
        "frames-csv": Reader(read_frames, "frames.csv", b"index,t,status\n0,0.0,OK\n1,0.1,LOST\n"),
        "bag-mcap": Reader(_read_bag, "bag.mcap", bag()[0], beside={"metadata.yaml": bag()[1]}),
        "engine-state": Reader(_use_engine, "engine.state", engine_state(), sealed=True),
        "saved-map": Reader(_use_map, "saved.map", saved_map(), sealed=True),
        "summary-json": Reader(read_summary, "summary.json", b'{"frames": 3, "mode": "collab"}\n'),
    }


def _read_bag(path: Path) -> None:
    recording = open_recording(path.parent, topics=TOPICS)
    for i in range(len(recording)):
        recording.frame(i)


def _use_engine(path: Path) -> None:
    slam, recording = Slam.load(path), SmallRecording()
    slam.step((slam.filter.time or 0.0) + 0.1, recording.image(1))


def _use_map(path: Path) -> None:
    recording = SmallRecording()
    slam = Slam(recording.camera, start="map", map=SavedMap.load(path))
    slam.step(0.0, recording.image(0))


_T = np.arange(3.0)
_POSES = np.tile(np.eye(4), (3, 1, 1))
_LANDMARKS = Landmarks(np.arange(3), np.arange(9.0).reshape(3, 3), np.tile(np.eye(3), (3, 1, 1)))


def _written(write: Callable[[Path], object]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "file"
        write(path)
        return path.read_bytes()


def _encoded(suffix: str) -> bytes:
    image = (np.arange(24 * 32).reshape(24, 32) % 251).astype(np.uint8)
    return bytes(cv2.imencode(suffix, image)[1].tobytes())


def damaged(good: bytes, rng: np.random.Generator) -> bytes:
    """A good file with one to four pieces of damage."""
    data = bytearray(good)
    for _ in range(int(rng.integers(1, 5))):
        kind = int(rng.integers(6))
        at = int(rng.integers(len(data) + 1))
        end = min(len(data), at + int(rng.integers(1, 40)))
        if kind == 0:
            data[at:end] = b""
        elif kind == 1:
            data[at:end] = TOKENS[int(rng.integers(len(TOKENS)))]
        elif kind == 2:
            data[at:at] = data[at:end] * int(rng.integers(1, 4))
        elif kind == 3 and at < len(data):
            data[at] ^= 1 << int(rng.integers(8))
        elif kind == 4:
            data[at:end] = rng.integers(0, 256, end - at, dtype=np.uint8).tobytes()
        elif int(rng.integers(4)) == 0:
            del data[at:]
    return bytes(data)


def read_one(reader: Reader, folder: Path, data: bytes) -> bool:
    """Gives a reader its file with this content: whether it is read, and not refused."""
    path = folder / reader.name
    path.write_bytes(seal(data) if reader.sealed else data)
    for name, content in reader.beside.items():
        (folder / name).write_bytes(content)
    try:
        reader.read(path)
    except CollabslamError:
        return False
    return True


def fuzz_readers(count: int, seed: int, *, which: Mapping[str, Reader] | None = None) -> ReaderFindings:
    """Damaged files for the readers in turn.

    Parameters
    ----------
    count : int
        Files in all.
    seed : int
    which : mapping, optional
        The readers; all of them if left out.
    """
    chosen = readers() if which is None else dict(which)
    names = sorted(chosen)
    rng = np.random.Generator(np.random.PCG64(seed))
    out = ReaderFindings()
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        (folder / "data").mkdir()
        for k in range(count):
            name = names[k % len(names)]
            data = damaged(chosen[name].good, rng)
            began = time.process_time()
            try:
                out.refused += not read_one(chosen[name], folder, data)
            except Exception as error:  # whatever it is: that is what is looked for
                out.findings.append(f"{name}: {type(error).__name__}: {str(error)[:100]}: {data[:200]!r}")
            seconds = time.process_time() - began
            out.slowest_s = max(out.slowest_s, seconds)
            if seconds > SLOW_S:
                out.findings.append(f"{name}: took {seconds:.1f} s: {data[:200]!r}")
            out.executions += 1
    return out

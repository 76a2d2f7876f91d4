"""Small good files of the kinds that hold whole recordings, maps and engines, to be damaged."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.ros.writer import write_bag
from collabslam.frontend.patch import capture
from collabslam.geometry import se3_exp
from collabslam.slam.engine import Slam
from collabslam.slam.map.saved_map import SavedMap
from collabslam.types import Frame, Image, WornView

WIDTH, HEIGHT, FRAMES = 48, 32, 3


class SmallRecording:
    """A few small noisy images of both cameras."""

    def __init__(self) -> None:
        self.name, self.source, self.target = "small", "small", None
        self.camera = self.worn_camera = Camera(
            "radtan", WIDTH, HEIGHT, (40.0, 40.0, 23.5, 15.5), (0.0, 0.01, 0.0, 0.0)
        )
        self.times = np.arange(1.0, 1.0 + 0.1 * FRAMES, 0.1)[:FRAMES]
        self.truth = np.stack([se3_exp([0.1 * k, 0.0, 0.0, 0.0, 0.0, 0.0]) for k in range(FRAMES)])

    def __len__(self) -> int:
        return FRAMES

    def image(self, i: int) -> Image:
        """The (H, W) uint8 image of Cs in frame ``i``."""
        return np.random.default_rng(i).integers(0, 256, (HEIGHT, WIDTH), dtype=np.uint8)

    def frame(self, i: int) -> Frame:
        """Frame ``i``."""
        t_cf = se3_exp([0.5, 0.0, 0.1, 0.0, 0.1, 0.0])
        view = WornView(self.image(i), t_cf, 1e-4 * np.eye(6))
        return Frame(i, float(self.times[i]), self.image(i), (view,))


@cache
def bag() -> tuple[bytes, bytes]:
    """A ROS 2 bag of the small recording: its MCAP file and its ``metadata.yaml``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        write_bag(SmallRecording(), path, storage="mcap")
        return (path / "bag.mcap").read_bytes(), (path / "metadata.yaml").read_bytes()


@cache
def engine_state() -> bytes:
    """What `Slam.save` writes, of an engine with a few features."""
    recording = SmallRecording()
    slam = Slam(recording.camera, start="scale-free")
    slam.step(0.0, recording.image(0))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "state"
        slam.save(path)
        return path.read_bytes()


@cache
def saved_map() -> bytes:
    """A map of three landmarks."""
    recording = SmallRecording()
    uv = np.array([[12.0, 10.0], [30.0, 12.0], [24.0, 20.0]])
    views = [[patch] for patch in capture(recording.image(0), uv, np.eye(4))]
    landmarks = np.tile([0.0, 0.0, 0.0, 0.1, 0.1, 0.5], (3, 1))
    known = SavedMap(recording.camera, True, landmarks, 1e-4 * np.eye(18), 1e-6 * np.eye(6), views)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map"
        known.save(path)
        return path.read_bytes()

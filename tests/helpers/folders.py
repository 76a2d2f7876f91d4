"""Tiny recordings as folders of images."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

SIZE = (32, 24)
START_NS = 1_403_715_285_262_142_976
SENSOR = """%YAML:1.0
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, {x}, 1.0, 0.0, 0.0, 0.2, 0.0, 0.0, 1.0, 0.3, 0.0, 0.0, 0.0, 1.0]
resolution: [32, 24]
camera_model: pinhole
intrinsics: [30.0, 31.0, 15.5, 11.5]
distortion_model: radial-tangential
distortion_coefficients: [-0.2, 0.07, 1e-05, 1.7e-5]
"""


def picture(seed: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (size[1], size[0]), dtype=np.uint8)


def write_images(folder: Path, names: list[str], first_seed: int = 0, size: tuple[int, int] = SIZE) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for k, name in enumerate(names):
        assert cv2.imwrite(str(folder / name), picture(first_seed + k, size))


def make_euroc(root: Path, frames: int = 4, listed: bool = True) -> list[int]:
    stamps = [START_NS + 50_000_000 * k for k in range(frames)]
    for camera, x, seed in (("cam0", 0.1, 0), ("cam1", 0.6, 100)):
        folder = root / "mav0" / camera
        write_images(folder / "data", [f"{s}.png" for s in stamps], seed)
        (folder / "sensor.yaml").write_text(SENSOR.format(x=x))
        if listed:
            lines = [f"{s},{s}.png" for s in stamps]
            (folder / "data.csv").write_text("\n".join(["#timestamp [ns],filename", *lines]))
    return stamps

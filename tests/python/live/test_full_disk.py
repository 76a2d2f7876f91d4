"""A disk that takes no more of a record or a checkpoint: the poses of all frames are there.

The limit is one of the size of a file, which needs no rights: beyond it a write fails as on a full disk.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("resource", reason="a system without such limits")

FRAMES, LIMIT = 12, 1 << 16
LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, ({0}, {0}))
from collabslam.cli.main import main
sys.exit(main(sys.argv[1:]))
"""
CAMERA = {
    "camera_model": "pinhole",
    "resolution": [320, 240],
    "intrinsics": [300.0, 300.0, 159.5, 119.5],
    "distortion_model": "none",
    "distortion_coefficients": [],
    "rate": 10.0,
}


def test_a_full_disk_takes_neither_poses_nor_the_summary(tmp_path: Path) -> None:
    images = tmp_path / "images"
    images.mkdir()
    noise = np.random.default_rng(0).integers(0, 255, (240, 320)).astype(np.uint8)
    for k in range(FRAMES):
        cv2.imwrite(str(images / f"{k:02d}.png"), np.roll(noise, k, axis=1))
    (tmp_path / "robot.yaml").write_text(json.dumps(CAMERA))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    out, record = tmp_path / "out", tmp_path / "record"
    words = [images, "--camera", tmp_path / "robot.yaml", "--out", out, "--record", record, "--insecure"]
    words += ["--listen", address, "--mode", "mono", "--start", "scale-free", "--checkpoint-every", "4"]
    command = [sys.executable, "-c", LIMITED.format(LIMIT), "live", "robot", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert "the record ends here, the robot goes on: The record cannot be written" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("collabslam: error: The ")
    assert max(p.stat().st_size for p in record.iterdir()) <= LIMIT
    assert (out / "frames.csv").read_text().count("\n") == 1 + FRAMES
    assert json.loads((out / "summary.json").read_text())["not written"] == "checkpoint, record"

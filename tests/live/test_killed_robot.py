"""A robot in a process of its own that is killed while a browser looks: no page stays as it was."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("websockets", reason="the extra live is not installed")

from browser import CHROMIUM, browser
from pages_site import SHOTS, SOON, free_address, served
from phone_scene import PHONE

from collabslam.live import link
from collabslam.live.gateway import Gateway
from collabslam.live.keys import make_keys
from collabslam.simulation import corridor_recording

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")


def drive(folder: Path) -> list[str]:
    """The robot's camera alone for two minutes, in the words of the command line."""
    corridor = corridor_recording()
    image, lens = corridor.frame(0).image, corridor.camera
    images = folder / "images"
    images.mkdir()
    for k in range(240):
        cv2.imwrite(str(images / f"{k:03d}.jpg"), np.roll(image, k % 8, axis=1))
    values = {"resolution": [lens.width, lens.height], "intrinsics": list(lens.intrinsics), "rate": 2.0}
    model = {"camera_model": "pinhole", "distortion_model": "none", "distortion_coefficients": []}
    (folder / "robot.yaml").write_text(json.dumps(values | model))
    return [str(images), "--camera", str(folder / "robot.yaml"), "--out", str(folder / "out")]


def test_pages_go_red_when_the_robot_is_killed(tmp_path: Path) -> None:
    """The phone is not started: its page tells the calibration the robot waits for, and shows its view."""
    make_keys(tmp_path, hosts=[], devices=[], web_hosts=["127.0.0.1"])
    address = free_address()
    words = ["--tag", "36h11:3=0.3", "--insecure", "--listen", f"127.0.0.1:{address.port}"]
    command = [sys.executable, "-m", "collabslam", "live", "robot", *drive(tmp_path), *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as robot:
        try:
            with (
                link.open_device(address, None) as session,
                served(Gateway(session, "web", PHONE), tmp_path / "web") as port,
                browser(tmp_path / "none.mjpeg") as whole,
            ):
                pages = {role: whole.page() for role in ("view", "phone")}
                pages["view"].open(f"https://127.0.0.1:{port}/view#t=view", 390, 1000)
                pages["phone"].open(f"https://127.0.0.1:{port}/#t=phone", 390, 1000)
                for name, page in pages.items():
                    assert page.until("document.getElementById('view').naturalWidth > 0", SOON)
                    assert page.until("document.getElementById('facts').rows.length > 1", SOON)
                    assert page.until("!document.body.classList.contains('silent')", SOON)
                    page.screenshot(SHOTS / f"{name}-before.png")
                robot.kill()
                for name, page in pages.items():
                    said = "document.getElementById('said')"
                    assert page.until(f"{said}.textContent.startsWith('the robot is silent')", SOON)
                    assert page.value(f"{said}.className") == "state bad"
                    assert page.value("document.body.classList.contains('silent')")
                    page.screenshot(SHOTS / f"{name}-dead.png")
        finally:
            robot.kill()

"""A phone that tracks itself: a browser whose WebXR is played, with Cf's rendered pictures and their poses.

No real phone takes part: what is played is what the standard says that a session gives.
"""

from __future__ import annotations

import base64
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("websockets", reason="the extra live is not installed")

from browser import CHROMIUM
from pages_site import SHOTS, SOON, site
from phone_scene import PHONE, tracked_shots
from scenario import frames_of

from collabslam.datasets.written_numbers import stable_quaternion
from collabslam.geometry import pose, rotation_exp
from collabslam.types import Array

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")

BEGINS = pose(rotation_exp([0.0, -1.2, 0.0]), [5.0, -3.0, 2.0])
"""Of the phone's own world."""
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
PLAYED = (Path(__file__).parent / "xr_playback.js").read_text()


def projection() -> list[float]:
    """WebXR's matrix, column by column, of the phone's calibration."""
    (fx, fy, cx, cy), w, h = PHONE.intrinsics, PHONE.width, PHONE.height
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = 2.0 * fx / w, 2.0 * fy / h
    matrix[0, 2], matrix[1, 2] = 1.0 - 2.0 * (cx + 0.5) / w, 2.0 * (cy + 0.5) / h - 1.0
    matrix[2:, 2] = -1.0
    return [float(v) for v in matrix.T.ravel()]


def shot(image: Array, t_wf: Array) -> dict[str, object]:
    """A picture and the pose that WebXR tells of it."""
    own = BEGINS @ t_wf @ FLIP
    w, x, y, z = stable_quaternion(own[:3, :3])
    jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
    place = [float(v) for v in own[:3, 3]]
    return {"jpeg": base64.b64encode(jpeg).decode(), "place": place, "turn": [x, y, z, w]}


def test_a_phone_that_saw_the_tag_once(tmp_path: Path) -> None:
    shots = [shot(image, t_wf) for image, t_wf in tracked_shots()]
    facts = {"shots": shots, "projection": projection(), "width": PHONE.width, "height": PHONE.height}
    with site(tmp_path, None) as there:
        page = there.browser.page()
        page.before(PLAYED.replace("FACTS", json.dumps(facts), 1))
        page.open(there.address("", "phone"), 390, 800)
        assert page.until("!document.getElementById('track').hidden", SOON)
        page.screenshot(SHOTS / "phone-ar-390.png")
        page.value("document.getElementById('track').click()")
        assert page.until("document.getElementById('facts').textContent.includes('images sent')", SOON)
        assert there.until(lambda: [link for _, link in frames_of(there.out)].count("collab") > 5)
        page.value("played.away = true")
        before = len(frames_of(there.out))
        assert there.until(lambda: len(frames_of(there.out)) > before + 50)  # ten seconds and more
        links = [link for _, link in frames_of(there.out)[before + 15 :]]
        assert links.count("collab") > len(links) // 2
        assert there.node.uplink.dropped["malformed"] == 0
        assert there.until(there.went)
        way, true = there.ways()
        assert np.abs(way - true).max() < 0.2


def test_without_tracking_the_plain_camera_is_offered(tmp_path: Path) -> None:
    """Chromium without a device has no AR; one that refuses the camera says what to do instead."""
    with site(tmp_path, PHONE) as there:
        page = there.browser.page()
        page.open(there.address("", "phone"), 390, 800)
        assert page.until("document.getElementById('start').disabled === false", SOON)
        assert page.value("document.getElementById('track').hidden")
        page.close()
        page = there.browser.page()
        refusing = {
            "shots": [],
            "projection": projection(),
            "width": 1,
            "height": 1,
            "refuse": "no camera-access",
        }
        page.before(PLAYED.replace("FACTS", json.dumps(refusing), 1))
        page.open(there.address("", "phone"), 390, 800)
        assert page.until("!document.getElementById('track').hidden", SOON)
        page.value("document.getElementById('track').click()")
        assert page.until("document.getElementById('said').textContent.includes('no camera-access')", SOON)
        page.value("document.getElementById('start').click()")
        assert page.until("document.getElementById('facts').textContent.includes('images sent')", SOON)
        assert there.until(lambda: there.node.uplink.calibrations([""], 0.0))

"""A real browser: a phone's page with a camera that plays Cf's rendered pictures, and the live view.

Screenshots of both pages, 1280 and 390 pixels wide, are left in ``results/pages`` to be looked at.
"""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("websockets", reason="the extra live is not installed")

from browser import CHROMIUM, Browser, browser

from collabslam import Camera, Settings
from collabslam.datasets.wrapped import FirstFrames
from collabslam.demo import corridor_recording
from collabslam.demo.demo_run import HeldRecording
from collabslam.live import link
from collabslam.live.cameras import PlayedRecording
from collabslam.live.gateway import Gateway
from collabslam.live.keys import make_keys
from collabslam.live.robot import RobotNode, RobotOptions
from collabslam.live.sending import send_all
from collabslam.live.web import Tokens, WebServer
from collabslam.live.worn import WornDevice

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")

TOKENS = Tokens("phone", "view")
SHOTS = Path(__file__).parents[2] / "results" / "pages"
SIZE = (640, 480)
SECONDS = 40


class Slow(HeldRecording):
    """The corridor's first frames, two a second, so that a browser has time to look."""

    def __init__(self, frames: int) -> None:
        super().__init__(FirstFrames(corridor_recording(), frames), progress=False)
        self.times = np.arange(frames) / 2.0


@dataclass(frozen=True)
class Site:
    port: int
    node: RobotNode
    phone: Browser


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("site")
    make_keys(folder, hosts=[], devices=[], web_hosts=["127.0.0.1"])
    recording = Slow(2 * SECONDS)
    video = folder / "phone.mjpeg"
    with video.open("wb") as file:
        for i in range(12):
            worn = recording.frame(i).worn
            assert worn is not None
            file.write(cv2.imencode(".jpg", cv2.resize(worn.image, SIZE))[1].tobytes())
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        address = link.Address("127.0.0.1", s.getsockname()[1])
    with link.open_robot(address, None) as at_robot, link.open_device(address, None) as at_device:
        options = RobotOptions(folder / "out", Settings.default())
        node = RobotNode(at_robot, PlayedRecording(recording), options)
        robot = threading.Thread(target=node.run, daemon=True)
        robot.start()
        camera = Camera("pinhole", *SIZE, (545.0, 615.0, 320.0, 240.0))
        server = WebServer(Gateway(at_device, "web", camera), TOKENS)
        loop = asyncio.new_event_loop()
        found: list[int] = []
        ready, done = threading.Event(), asyncio.Event()

        async def serve() -> None:
            async with server.serving("127.0.0.1", 0, folder / "web") as number:
                found.append(number)
                ready.set()
                await done.wait()

        thread = threading.Thread(target=lambda: loop.run_until_complete(serve()), daemon=True)
        thread.start()
        assert ready.wait(10.0)
        played = PlayedRecording(recording)
        with WornDevice(at_device, "anna", recording.worn_camera, played.clock) as anna:
            sending = threading.Thread(target=lambda: send_all(anna, played, done.is_set), daemon=True)
            sending.start()
            with browser(video) as page:
                yield Site(found[0], node, page)
            loop.call_soon_threadsafe(done.set)
            sending.join(10.0)
        thread.join(10.0)
        loop.close()
        robot.join(SECONDS)


def fits(page: Browser) -> bool:
    """Whether nothing is cut off at the side."""
    return bool(page.value("document.documentElement.scrollWidth <= innerWidth"))


@pytest.mark.parametrize("width", [1280, 390])
def test_the_phone_sends_its_camera(site: Site, width: int) -> None:
    before = site.node.uplink.reports().get("web", {}).get("images", 0)
    site.phone.open(f"https://127.0.0.1:{site.port}/?{width}#t=phone&start=1", width, 800)
    assert site.phone.until("document.getElementById('said').textContent.startsWith('Sending')", 15.0)
    assert site.phone.until("document.getElementById('view').naturalWidth > 0", 10.0)
    assert site.phone.until("document.getElementById('facts').rows.length > 5", 10.0)
    assert site.phone.until(
        "Number(document.getElementById('facts').rows[0].cells[1].textContent) > 20", 10.0
    )
    site.phone.screenshot(SHOTS / f"phone-{width}.png")
    assert fits(site.phone)
    report = site.node.uplink.reports()["web"]
    assert report["images"] > before + 15
    assert 0.0 < report["age_median_ms"] < 300.0
    assert site.node.uplink.dropped["malformed"] == 0


@pytest.mark.parametrize("width", [1280, 390])
def test_the_view_shows_what_happens(site: Site, width: int) -> None:
    site.phone.open(f"https://127.0.0.1:{site.port}/view?{width}#t=view", width, 1400)
    assert site.phone.until("document.getElementById('said').textContent.startsWith('OK')", 10.0)
    assert site.phone.until("document.getElementById('view').naturalWidth > 0", 10.0)
    assert site.phone.until("document.getElementById('facts').rows.length > 5", 10.0)
    site.phone.screenshot(SHOTS / f"view-{width}.png")
    assert fits(site.phone)


def test_a_wrong_token_is_told(site: Site) -> None:
    site.phone.open(f"https://127.0.0.1:{site.port}/view?wrong#t=other", 390, 800)
    assert site.phone.until("document.getElementById('said').textContent.includes('token')", 10.0)

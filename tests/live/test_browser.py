"""A real browser: a phone's page with a camera that plays Cf's rendered pictures, and the live view.

Screenshots of both pages, 1280 and 390 pixels wide, are left in ``results/pages`` to be looked at.
"""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("websockets", reason="the extra live is not installed")

from browser import CHROMIUM, Browser, browser
from phone_scene import PHONE, TAG, ThereAndBack, phone_video
from scenario import frames_of

from collabslam import Settings
from collabslam.datasets.poses import read_track
from collabslam.live import link
from collabslam.live.cameras import PlayedRecording
from collabslam.live.gateway import Gateway
from collabslam.live.keys import make_keys
from collabslam.live.robot import RobotNode, RobotOptions
from collabslam.live.shots import Shot
from collabslam.live.web import Tokens, WebServer

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")

TOKENS = Tokens("phone", "view")
SHOTS = Path(__file__).parents[2] / "results" / "pages"
SOON = 90.0
"""Seconds in which a page does what it should, however busy the machine."""


class Ending(PlayedRecording):
    """Ends when the browser has seen enough."""

    def __init__(self, recording: ThereAndBack) -> None:
        super().__init__(recording)
        self.enough = threading.Event()

    def shots(self, ended: Callable[[], bool]) -> Iterator[Shot]:
        return super().shots(self.enough.is_set)


@dataclass(frozen=True)
class Site:
    """The pages' port, the robot with its result folder, and what it sees, a browser and its phone's page."""

    port: int
    node: RobotNode
    out: Path
    recording: ThereAndBack
    browser: Browser
    phone: Browser

    def address(self, page: str, token: str) -> str:
        return f"https://127.0.0.1:{self.port}/{page}#t={token}"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("site")
    make_keys(folder, hosts=[], devices=[], web_hosts=["127.0.0.1"])
    recording = ThereAndBack()
    camera = Ending(recording)
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        address = link.Address("127.0.0.1", s.getsockname()[1])
    with link.open_robot(address, None) as at_robot, link.open_device(address, None) as at_device:
        options = RobotOptions(folder / "out", Settings.default(), targets=[TAG])
        node = RobotNode(at_robot, camera, options)
        robot = threading.Thread(target=node.run, daemon=True)
        robot.start()
        server = WebServer(Gateway(at_device, "web", PHONE), TOKENS)
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
        assert ready.wait(SOON)
        try:
            with browser(phone_video(folder / "phone.mjpeg")) as whole:
                site = Site(found[0], node, folder / "out", recording, whole, whole.page())
                site.phone.open(site.address("", "phone&start=1"), 1280, 800)
                yield site
        finally:
            camera.enough.set()
            loop.call_soon_threadsafe(done.set)
            thread.join(SOON)
            loop.close()
            robot.join(SOON)


def fits(page: Browser) -> bool:
    """Whether nothing is cut off at the side."""
    return bool(page.value("document.documentElement.scrollWidth <= innerWidth"))


def until(true: Callable[[], bool]) -> bool:
    end = time.monotonic() + SOON
    while time.monotonic() < end:
        if true():
            return True
        time.sleep(0.1)
    return False


def test_the_phone_sends_its_camera(site: Site) -> None:
    assert site.phone.until("document.getElementById('said').textContent.startsWith('Sending')", SOON)
    assert until(lambda: site.node.uplink.reports().get("web", {}).get("images", 0) > 20)
    report = site.node.uplink.reports()["web"]
    assert 0.0 < report["age_median_ms"] < 2000.0  # the two clocks began years apart
    assert site.node.uplink.dropped["malformed"] == 0


def test_a_phone_and_a_tag_make_a_metric_pose(site: Site) -> None:
    """Nothing but the tag that both see tells where the phone is, and that a metre is one."""
    assert until(lambda: [link for _, link in frames_of(site.out)].count("collab") > 50)
    stamps, poses = read_track(site.out / "trajectory.tum")
    truth = site.recording.truth[np.round(stamps * 5.0).astype(int)]
    way, true = (np.linalg.norm(p[:, :3, 3] - p[:1, :3, 3], axis=1) for p in (poses, truth))
    assert true.max() > 0.9
    assert np.abs(way - true).max() < 0.2
    assert site.phone.until("document.getElementById('facts').textContent.includes('metricTrue')", SOON)


@pytest.mark.parametrize("width", [1280, 390])
def test_the_phone_shows_what_the_robot_sees(site: Site, width: int) -> None:
    site.phone.resize(width, 800)
    assert site.phone.until("document.getElementById('view').naturalWidth > 0", SOON)
    assert site.phone.until("document.getElementById('facts').rows.length > 5", SOON)
    assert fits(site.phone)
    site.phone.screenshot(SHOTS / f"phone-{width}.png")


@pytest.mark.parametrize("width", [1280, 390])
def test_the_view_shows_what_happens(site: Site, width: int) -> None:
    view = site.browser.page()
    view.open(site.address("view", "view"), width, 1400)
    assert view.until("document.getElementById('said').textContent.startsWith('OK · collab')", SOON)
    assert view.until("document.getElementById('view').naturalWidth > 900", SOON)  # both cameras
    assert view.until("document.getElementById('facts').rows.length > 5", SOON)
    assert fits(view)
    view.screenshot(SHOTS / f"view-{width}.png")
    view.close()


def test_a_wrong_token_is_told(site: Site) -> None:
    view = site.browser.page()
    view.open(site.address("view", "other"), 390, 800)
    assert view.until("document.getElementById('said').textContent.includes('token')", SOON)
    view.close()

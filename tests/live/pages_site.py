"""The pages while a robot drives: server, robot and browser in one process, for as long as a test looks."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from browser import Browser, browser
from phone_scene import TAG, ThereAndBack, phone_video

from collabslam import Camera, Settings
from collabslam.live import link
from collabslam.live.cameras import RecordingPlayback
from collabslam.live.frame_source import CapturedImage
from collabslam.live.gateway import Gateway
from collabslam.live.keys import make_keys
from collabslam.live.robot import RobotNode, RobotOptions
from collabslam.live.web import Tokens, WebServer

TOKENS = Tokens("phone", "view")
SHOTS = Path(__file__).parents[2] / "results" / "pages"
SOON = 90.0
"""Seconds in which a page does what it should, however busy the machine."""


class Ending(RecordingPlayback):
    """Ends when the browser has seen enough."""

    def __init__(self, recording: ThereAndBack) -> None:
        super().__init__(recording)
        self.enough = threading.Event()

    def images(self, ended: Callable[[], bool]) -> Iterator[CapturedImage]:
        return super().images(self.enough.is_set)


@dataclass(frozen=True)
class Site:
    """The pages' port, the robot with its result folder, and what it sees, and a browser."""

    port: int
    node: RobotNode
    out: Path
    recording: ThereAndBack
    browser: Browser

    def address(self, page: str, token: str) -> str:
        return f"https://127.0.0.1:{self.port}/{page}#t={token}"


@contextmanager
def served(gateway: Gateway, keys: Path) -> Iterator[int]:
    """The pages, served by a thread until the block ends; gives the port."""
    server, loop = WebServer(gateway, TOKENS), asyncio.new_event_loop()
    found: list[int] = []
    ready, done = threading.Event(), asyncio.Event()

    async def serve() -> None:
        async with server.serving("127.0.0.1", 0, keys) as number:
            found.append(number)
            ready.set()
            await done.wait()

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()), daemon=True)
    thread.start()
    assert ready.wait(SOON)
    try:
        yield found[0]
    finally:
        loop.call_soon_threadsafe(done.set)
        thread.join(SOON)
        loop.close()


def free_address() -> link.Address:
    """Where nobody listens."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return link.Address("127.0.0.1", s.getsockname()[1])


@contextmanager
def site(folder: Path, phone: Camera | None) -> Iterator[Site]:
    """A robot that drives until the block ends, and pages for a phone of that calibration."""
    make_keys(folder, hosts=[], devices=[], web_hosts=["127.0.0.1"])
    recording = ThereAndBack()
    camera = Ending(recording)
    address = free_address()
    with link.open_robot(address, None) as at_robot, link.open_device(address, None) as at_device:
        options = RobotOptions(folder / "out", Settings.default(), targets=[TAG])
        node = RobotNode(at_robot, camera, options)
        robot = threading.Thread(target=node.run, daemon=True)
        robot.start()
        try:
            with (
                served(Gateway(at_device, "web", phone), folder / "web") as port,
                browser(phone_video(folder / "phone.mjpeg")) as whole,
            ):
                yield Site(port, node, folder / "out", recording, whole)
        finally:
            camera.enough.set()
            robot.join(SOON)


def until(true: Callable[[], bool]) -> bool:
    end = time.monotonic() + SOON
    while time.monotonic() < end:
        if true():
            return True
        time.sleep(0.1)
    return False

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
from typing import Any

import numpy as np
from browser import Browser, browser
from helpers.waiting import LONGEST
from phone_scene import RATE, TAG, ThereAndBack, phone_video
from scenario import frames_of

from collabslam import Camera, Settings
from collabslam.datasets.poses import read_track
from collabslam.live import link
from collabslam.live.cameras import RecordingPlayback
from collabslam.live.frame_source import CapturedImage
from collabslam.live.gateway import Gateway
from collabslam.live.keys import make_keys
from collabslam.live.robot import RobotNode, RobotOptions
from collabslam.live.web import Tokens, WebServer
from collabslam.types import Array

TOKENS = Tokens("phone", "view")
SHOTS = Path(__file__).parents[2] / "results" / "pages"
SOON = 90.0
"""Seconds in which a page does what it should, however busy the machine."""
SAME = 1e-3
"""Seconds by which written stamps of a frame differ at most."""


class AsFastAsItGoes(RecordingPlayback):
    """Gives an image when the robot is done with the one before, and ends when the browser has seen enough.

    An image is stamped as it is given: on a busy machine the robot drives more slowly, and loses none.
    """

    def __init__(self, recording: ThereAndBack) -> None:
        super().__init__(recording)
        self.enough = threading.Event()
        self.stamps: list[float] = []
        self._done = 0

    def follow(self, node: RobotNode) -> None:
        """This robot is waited for."""
        done = node._done

        def note_done(*arguments: Any) -> None:
            done(*arguments)
            self._done += 1

        node._done = note_done  # type: ignore[method-assign]

    def images(self, ended: Callable[[], bool]) -> Iterator[CapturedImage]:
        for i in range(len(self.recording)):
            frame, begun = self.recording.frame(i), self.clock.now()
            last = self.stamps[-1] if self.stamps else begun
            self.wait_until(last + 1.0 / RATE, self.clock.now, self.enough.is_set)
            while self._done < i and not self.enough.is_set():
                time.sleep(0.005)
            if self.enough.is_set():
                return
            self.stamps.append(self.clock.now())
            yield CapturedImage(self.stamps[-1], frame.image)


@dataclass(frozen=True)
class Site:
    """The pages' port, the robot with its result folder, and what it sees, and a browser."""

    port: int
    node: RobotNode
    out: Path
    recording: ThereAndBack
    browser: Browser
    camera: AsFastAsItGoes

    def until(self, true: Callable[[], bool]) -> bool:
        """Whether it comes true before the robot has driven its last frame, however long it takes to."""
        driven, moved = 0, time.monotonic()
        while not true():
            if len(self.camera.stamps) > driven:
                driven, moved = len(self.camera.stamps), time.monotonic()
            if driven == len(self.recording) or time.monotonic() - moved > LONGEST:
                return False
            time.sleep(0.1)
        return True

    def ways(self) -> tuple[Array, Array]:
        """How far each frame whose pose is OK is from that nearest to where the way begins, metres: by
        its poses, and in truth, (N,) both.

        The robot is anywhere on its way when the phone comes.  Where a busy machine takes seconds for a frame
        it is COASTING: what it tells then is a prediction, and said to be one.
        """
        fine = np.array([t for t, status in frames_of(self.out, "status") if status == "OK"])
        if not len(fine):
            return np.zeros(0), np.zeros(0)
        stamps, poses = read_track(self.out / "trajectory.tum")
        kept = np.abs(stamps[:, None] - fine[None]).min(axis=1) < SAME
        stamps, told = stamps[kept], poses[kept, :3, 3]
        given = np.array(self.camera.stamps)
        frames = np.abs(stamps[:, None] - given[None]).argmin(axis=1)
        assert np.abs(given[frames] - stamps).max(initial=0.0) < SAME
        true, begins = self.recording.truth[frames][:, :3, 3], self.recording.truth[0][:3, 3]
        first = int(np.argmin(np.linalg.norm(true - begins, axis=1)))
        return np.linalg.norm(told - told[first], axis=1), np.linalg.norm(true - true[first], axis=1)

    def went(self) -> bool:
        """Whether those were many, and over the whole way."""
        true = self.ways()[1]
        return len(true) > 30 and bool(true.max() > 0.9)

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
    camera = AsFastAsItGoes(recording)
    address = free_address()
    with link.open_robot(address, None) as at_robot, link.open_device(address, None) as at_device:
        options = RobotOptions(folder / "out", Settings.default(), targets=[TAG])
        node = RobotNode(at_robot, camera, options)
        camera.follow(node)
        robot = threading.Thread(target=node.run, daemon=True)
        robot.start()
        try:
            with (
                served(Gateway(at_device, "web", phone), folder / "web") as port,
                browser(phone_video(folder / "phone.mjpeg")) as whole,
            ):
                yield Site(port, node, folder / "out", recording, whole, camera)
        finally:
            camera.enough.set()
            robot.join(SOON)

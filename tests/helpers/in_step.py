"""A recording played as fast as the robot and its devices follow, so that a busy machine loses nothing."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from typing import Any

from helpers.waiting import until

from collabslam.live.cameras import RecordingPlayback
from collabslam.live.monotonic_clock import MonotonicClock
from collabslam.live.robot import RobotNode
from collabslam.live.sending import send_all
from collabslam.live.views import LiveView, sender_of
from collabslam.live.worn import WornDevice
from collabslam.types import Recording

AFTER = 0.005
"""Seconds by which the clock is past a frame's time, as devices know it to less."""


class SetClock(MonotonicClock):
    """Shows what it was set to."""

    def __init__(self, t: float) -> None:
        self.t = t

    def now(self) -> float:
        return self.t


class Behind(MonotonicClock):
    """Another device's clock: that of the robot, and some seconds more."""

    def __init__(self, camera: RecordingPlayback, offset: float) -> None:
        self._camera, self._offset = camera, offset

    def now(self) -> float:
        return self._camera.clock.now() + self._offset


class InStep(RecordingPlayback):
    """A frame comes when the one before is done, and the view of each person that goes with it is there."""

    def __init__(self, recording: Recording) -> None:
        super().__init__(recording)
        self._played, self._done, self._seen = 0, 0, 0
        self._views = Counter[str]()
        self._persons: tuple[str, ...] = ()

    def begin(self) -> None:
        self.clock = SetClock(float(self.recording.times[0]))

    def follow(self, node: RobotNode, *persons: str) -> None:
        """What this robot has done, and has heard of these persons, is waited for."""
        self._persons = persons
        done, push = node._done, node.uplink._push

        def note_done(*arguments: Any) -> None:
            done(*arguments)
            self._done += 1

        def note_view(event: Any) -> None:
            push(event)
            if isinstance(event, LiveView):
                self._views[sender_of(event.session)] += 1

        node._done, node.uplink._push = note_done, note_view  # type: ignore[method-assign]

    @staticmethod
    def send(device: WornDevice, camera: RecordingPlayback, robot: threading.Thread) -> None:
        """What a device sends until the robot is done; never as datagrams, which may be lost."""
        device.transport.datagrams = lambda sent: False  # type: ignore[method-assign]
        send_all(device, camera, lambda: not robot.is_alive())
        robot.join()

    def wait_until(self, t: float, now: Callable[[], float], ended: Callable[[], bool]) -> None:
        self.clock.t = t + AFTER  # type: ignore[attr-defined]
        assert until(lambda: self._done >= self._played), "a frame was lost"
        self._seen += bool(self.recording.frame(self._played).views)
        assert until(lambda: all(self._views[name] >= self._seen for name in self._persons)), "a view was"
        self._played += 1

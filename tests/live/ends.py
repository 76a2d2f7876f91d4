"""One end of a link in a process of its own: ``python ends.py robot|worn OPTIONS`` tells what it saw.

The worn end says ``up`` when it is there.  All times that are told are the machine's (``time.monotonic``).
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import collabslam
from collabslam.live import link, messages, names, slam
from collabslam.live.cameras import RecordingPlayback
from collabslam.live.core import Event, LiveCore, LivePose
from collabslam.live.keys import Keys
from collabslam.live.monotonic_clock import MonotonicClock
from collabslam.live.robot import RobotNode, RobotOptions
from collabslam.live.sending import send_all
from collabslam.live.views import LiveView
from collabslam.live.worn import WornDevice


class OtherClock(MonotonicClock):
    """A clock that is ``offset`` seconds off and runs ``drift`` too fast."""

    def __init__(self, offset: float, drift: float) -> None:
        super().__init__()
        self._start += offset
        self._drift = drift

    def now(self) -> float:
        return self._start + (1.0 + self._drift) * (time.monotonic() - self._begun)

    def monotonic(self, stamp: float) -> float:
        """The machine's time at which it showed ``stamp``."""
        return self._begun + (stamp - self._start) / (1.0 + self._drift)


class Listed(WornDevice):
    """Keeps each view's stamp, and the machine's time of it."""

    seen: list[tuple[float, float]]

    def send(self, t: float, image: Any, pose: Any = None, rate: Any = None) -> None:
        assert isinstance(self._clock, OtherClock)
        self.seen.append((t, self._clock.monotonic(t)))
        super().send(t, image, pose, rate)


def worn(asked: dict[str, Any]) -> dict[str, Any]:
    recording = collabslam.open_recording(asked["recording"])
    camera = RecordingPlayback(recording)
    camera.clock = clock = OtherClock(asked["offset"], asked["drift"])
    keys = Keys.read(Path(asked["keys"]))
    assert recording.worn_camera is not None
    with link.open_device(link.Address.parse(asked["host"]), keys) as session:
        device = Listed(session, keys.name, recording.worn_camera, clock)
        device.seen = []
        with device:
            print("up", flush=True)
            send_all(device, camera, lambda: False)
            time.sleep(0.5)
    return {"seen": device.seen, "level": device.pace.level.size}


class Timed(LiveCore):
    """Keeps how long each frame took, how long its thread worked on it, and when views were given to it."""

    frames: ClassVar[list[tuple[float, float]]] = []
    given: ClassVar[list[tuple[float, float]]] = []
    now: ClassVar[Callable[[], float]]

    def handle(self, event: Event) -> LivePose | None:
        if isinstance(event, LiveView):
            self.given.append((event.stamp, type(self).now()))
        began = time.perf_counter(), time.thread_time()
        pose = super().handle(event)
        if pose is not None:
            self.frames.append((time.perf_counter() - began[0], time.thread_time() - began[1]))
        return pose


def robot(asked: dict[str, Any]) -> dict[str, Any]:
    recording = collabslam.open_recording(asked["recording"])
    camera = RecordingPlayback(recording)
    record = Path(asked["record"]) if asked.get("record") else None
    options = RobotOptions(Path(asked["out"]), collabslam.Settings.default(), record=record)
    exchanges: list[tuple[float, float]] = []
    slam.LiveCore = Timed  # type: ignore[misc]
    Timed.now = camera.clock.now
    with link.open_robot(link.Address.parse(asked["host"]), Keys.read(Path(asked["keys"]))) as session:
        node = RobotNode(session, camera, options)
        take = node.uplink.take

        def listed(key: str, payload: bytes) -> None:
            if key.endswith(names.EXCHANGE):
                exchanges.append((camera.clock.now(), messages.exchange_from(payload)[1].delay))
            take(key, payload)

        node.uplink.take = listed  # type: ignore[method-assign]
        summary = node.run()
    offset = camera.clock._begun - camera.clock._start
    return {
        "summary": summary,
        "arrivals": [(a.stamp, a.taken + offset, a.came + offset) for a in node.uplink.arrivals("anna")],
        "given": [(stamp, t + offset) for stamp, t in Timed.given],
        "exchanges": [(t + offset, delay) for t, delay in exchanges],
        "offset": offset,
        "frames": Timed.frames,
        "received": dict(node.uplink.received),
    }


if __name__ == "__main__":
    asked = json.loads(sys.argv[2])
    told = {"robot": robot, "worn": worn}[sys.argv[1]](asked)
    Path(asked["tell"]).write_text(json.dumps(told))

"""What devices and pages may send, altered at random: nothing raises, and nothing grows."""

from __future__ import annotations

import asyncio
import contextlib
import json
import struct
from types import SimpleNamespace
from typing import Any

import numpy as np

from collabslam import Camera
from collabslam.errors import InputError
from collabslam.live import messages, names, web
from collabslam.live.arguments import checked
from collabslam.live.clock import ClockEstimator, Exchange
from collabslam.live.core import Event
from collabslam.live.gateway import Gateway, Phone
from collabslam.live.pace import Pace
from collabslam.live.uplink import STRANGERS, Uplink
from collabslam.worn_pose import LaserScan
from collabslam_lab.reliability.readers import ReaderFindings, damaged

CAMERA = Camera("pinhole", 640, 480, (500.0, 500.0, 320.0, 240.0))
JPEG = b"\xff\xd8\xff\xe0 and so on"
_EDGES: tuple[Any, ...] = (
    None, True, -1, 0, 1, 0.5, 3e9, -3e9, 1e308, 10**400, float("nan"), float("inf"), "", "x", "\ud800",
    [], {}, [[]], [1.0] * 4, [1.0] * 8, [10**400] * 4,
    [[1.0] * 4] * 9, [[10**400] * 4, [None] * 4, 7], ["x"] * 8, {"a": 1},
)  # fmt: skip
_WORDS = ("token", "watch", "width", "height", "intrinsics", "ask", "exchange", "own", "rates", "facts", "")


def fuzz_live(count: int, seed: int) -> ReaderFindings:
    """So many messages of devices, and as many of pages.

    Parameters
    ----------
    count, seed : int
    """
    rng, found = np.random.default_rng(seed), ReaderFindings()
    _devices(count, rng, found)
    asyncio.run(_pages(count, rng, found))
    return found


def good_messages() -> dict[str, bytes]:
    """One message of each part that a device may write, as it should be."""
    beams = LaserScan(7.0, np.full(9, 2.0), -0.4, 0.1, scanner="front", range_max=10.0)
    turn = np.array([0.0, 0.0, 0.0, 1.0])
    return {
        names.IMAGE: messages.compressed_image(7.0, "anna/1", JPEG),
        names.T_CF: messages.pose(7.0, "cs", np.eye(4), np.eye(6)),
        names.OWN: messages.pose(7.0, "anna/1", np.eye(4), np.eye(6)),
        names.CAMERA_INFO: messages.camera_info(7.0, "anna/1", CAMERA),
        names.EXCHANGE: messages.exchange("anna/1", Exchange(1.0, 2.0, 2.0, 1.1)),
        names.ATTITUDE: messages.attitude(7.0, "anna/1", turn),
        names.ROBOT_ATTITUDE: messages.attitude(7.0, "anna/1", turn),
        names.SCAN: messages.scan(7.0, "anna/1/front", beams),
        names.RATE: messages.rate(7.0, np.array([0.1, 0.2, 0.3]), frame="anna/1"),
        names.BEAT: b"",
    }


def _devices(count: int, rng: np.random.Generator, found: ReaderFindings) -> None:
    """Keys and messages, through what the robot hears them with."""
    good = good_messages()
    events: list[Event] = []
    up = Uplink(events.append, lambda: 7.0)
    for k in range(count):
        part = str(rng.choice(names.PARTS))
        key = names.key(str(rng.choice(["anna", "ben", f"eve{k}"])), part)
        if rng.random() < 0.1:
            key = damaged(key.encode(), rng).decode(errors="replace")
        payload = good[part] if rng.random() < 0.05 else damaged(good[part] or b"\0", rng)
        try:
            up.take(key, payload)
            for event in events:
                _checked(event)
        except Exception as error:
            found.findings.append(f"device {k}: {key!r}: {type(error).__name__}: {error}")
        found.refused += not events
        events.clear()
        found.executions += 1
        if k % 200 == 199:  # rates are those of clocks: a new robot has heard nothing
            grown = len(up.received) > STRANGERS or len(up.counts()) > 16 or len(up.faults) > 8
            told = up.calibrations(list(up.reports()), 0.0).values()
            grown = grown or any(c.width * c.height > messages.MOST_TOLD for c in told)
            if grown or not up.said().get("last refusal", "").isprintable():
                found.findings.append(f"device {k}: what is kept grows, or is no text")
            up = Uplink(events.append, lambda: 7.0)


def _checked(event: Event) -> None:
    """As the filter's door does; what it refuses costs its sender only."""
    with contextlib.suppress(InputError):
        checked(event)


async def _pages(count: int, rng: np.random.Generator, found: ReaderFindings) -> None:
    """Texts and images, through what the pages' server answers with."""
    sent: list[str] = []
    gateway: Any = SimpleNamespace(
        publish=lambda part, payload: None,
        ask=lambda: None,
        new_session=lambda: "web/1",
        robot_clock=ClockEstimator(),
        pace=Pace(),
        clock=SimpleNamespace(now=lambda: 7.0),
    )
    gateway.robot_clock.add(Exchange(1.0, 2.0, 2.0, 1.1))
    server = web.WebServer(gateway, web.Tokens("phone", "view"))
    socket: Any = SimpleNamespace(send=_into(sent))
    phone = Phone(gateway, "", CAMERA)
    whole = SimpleNamespace(_camera=CAMERA)
    for k in range(count):
        message = _message(rng)
        try:
            if isinstance(message, bytes):
                web._image(phone, message)
            else:
                told = web._object(message)
                await server._answer(socket, phone, told)
                Gateway._why_not(whole, told.get("width"), told.get("height"), mine=True)  # type: ignore[arg-type]
                web._bytes(str(told.get("token")))
        except Exception as error:
            found.findings.append(f"page {k}: {message[:80]!r}: {type(error).__name__}: {error}")
        found.refused += not sent
        sent.clear()
        found.executions += 1


def _into(sent: list[str]) -> Any:
    async def send(text: str) -> None:
        sent.append(text)

    return send


def _message(rng: np.random.Generator) -> str | bytes:
    if rng.random() < 0.2:
        return damaged(struct.pack(">d", float(rng.normal(0.0, 1e9))) + JPEG, rng)
    values = {
        str(rng.choice(_WORDS)): _EDGES[int(rng.integers(len(_EDGES)))]
        for _ in range(int(rng.integers(1, 4)))
    }
    text = json.dumps(values)
    return text if rng.random() < 0.6 else damaged(text.encode(), rng).decode(errors="replace")

"""What a broken or a hostile sender costs: its own messages, and nothing else."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("rosbags", reason="the extra live is not installed")
pytest.importorskip("cryptography", reason="the extra live is not installed")

from helpers.waiting import connected, until

from collabslam import Camera
from collabslam.live import link, messages, names, uplink
from collabslam.live.clock import Exchange
from collabslam.live.core import ClockReading, Event
from collabslam.live.keys import Keys, make_keys
from collabslam.live.uplink import Uplink
from collabslam.live.views import LiveView

JPEG = b"\xff\xd8\xff\xe0 and so on"
T_CF = messages.pose(7.0, "cs", np.eye(4), np.eye(6))


def listening() -> tuple[Uplink, list[Event]]:
    events: list[Event] = []
    return Uplink(events.append, lambda: 7.0), events


def send(up: Uplink, name: str, t: float = 7.0) -> None:
    up.take(names.key(name, names.T_CF), messages.pose(t, "cs", np.eye(4), np.eye(6)))
    up.take(names.key(name, names.IMAGE), messages.compressed_image(t, f"{name}/1", JPEG))


def good() -> dict[str, bytes]:
    camera = Camera("pinhole", 64, 48, (50.0, 50.0, 32.0, 24.0))
    return {
        names.IMAGE: messages.compressed_image(7.0, "anna/1", JPEG),
        names.T_CF: T_CF,
        names.CAMERA_INFO: messages.camera_info(7.0, "anna/1", camera),
        names.EXCHANGE: messages.exchange("anna/1", Exchange(1.0, 2.0, 2.0, 1.1)),
        names.RATE: messages.rate(7.0, np.array([0.1, 0.2, 0.3]), frame="anna/1"),
    }


def test_what_is_good_becomes_events(clip: Clip) -> None:
    up, events = listening()
    for part, payload in good().items():
        up.take(names.key("anna", part), payload)
    (view,) = [e for e in events if isinstance(e, LiveView)]
    (reading,) = [e for e in events if isinstance(e, ClockReading)]
    assert view.session == reading.session == "anna/1"
    assert view.image == JPEG
    assert up.counts() == {}


def test_who_is_heard_without_its_images_is_told_so() -> None:
    """Or a device whose images are all lost on the way would not know."""
    up, _ = listening()
    up.take(names.key("anna", names.EXCHANGE), good()[names.EXCHANGE])
    send(up, "ben")
    reports = up.reports()
    assert reports["anna"] == {"images": 0}
    assert reports["ben"]["images"] == 1


@pytest.mark.parametrize("part", list(good()))
def test_altered_messages_cost_only_themselves(part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(uplink.RATES, part, 1e9)
    up, events = listening()
    generator = np.random.default_rng(0)
    for k in range(400):
        payload = bytearray(good()[part])
        for place in generator.integers(0, len(payload), 1 + k % 8):
            payload[place] = int(generator.integers(0, 256))
        up.take(names.key("eve", part), bytes(payload[: generator.integers(0, len(payload) + 1)]))
    for rubbish in (b"", b"\0", bytes(1000), b"\xff" * 1000, generator.bytes(5000)):
        up.take(names.key("eve", part), rubbish)
        up.take(names.key("eve", "another"), rubbish)
    assert up.counts()["malformed"] >= 300
    assert any(fault.startswith("eve: ") for fault in up.faults)
    assert "collabslam/worn/NAME/PART" in up.said()["last refusal"]
    assert max(map(len, up.faults)) <= uplink.LONGEST
    events.clear()
    send(up, "anna")
    assert [e.session for e in events if isinstance(e, LiveView)] == ["anna/1"]


def test_a_device_speaks_for_itself_only() -> None:
    up, events = listening()
    up.take(names.key("eve", names.T_CF), T_CF)
    up.take(names.key("eve", names.IMAGE), messages.compressed_image(7.0, "anna/1", JPEG))
    assert [e.session for e in events if isinstance(e, LiveView)] == ["eve/1"]


FOREIGN = [
    "collabslam/worn/eve/anna/image",
    "collabslam/worn/eve/anna/pose",
    "collabslam/worn/eve/x/anna/image",
    "collabslam/worn/*/image",
    "collabslam/worn/**",
    "collabslam/worn/eve/**",
    "collabslam/worn/eve/$*",
    "collabslam/worn/eve",
    "collabslam/worn/eve/",
    "collabslam/worn//image",
    "collabslam/worn/eve/image/",
    "collabslam/worn/eve/image\n",
    "collabslam/worn/Anna/image",
    "collabslam/robot/anna/image",
    "anna/image",
    "x/collabslam/worn/anna/image",
    "",
]


@pytest.mark.parametrize("key", FOREIGN)
def test_a_key_is_exactly_a_device_and_a_part(key: str) -> None:
    up, events = listening()
    send(up, "anna")
    up.take(key, messages.compressed_image(8.0, "anna/1", JPEG))
    up.take(key, messages.pose(8.0, "cs", np.eye(4), np.eye(6)))
    assert up.counts() == {"malformed": 2}
    assert set(up.reports()) == {"anna"}
    assert len(events) == 1


@pytest.mark.parametrize("start", ["1\n2", "a b", "x" * 65, 'a","b', "\x1b[2J", "é", "a.b", "1\0"])
def test_a_session_has_an_alphabet(start: str) -> None:
    up, events = listening()
    up.take(names.key("anna", names.T_CF), T_CF)
    up.take(names.key("anna", names.IMAGE), messages.compressed_image(7.0, f"anna/{start}", JPEG))
    up.take(names.key("anna", names.EXCHANGE), messages.exchange(start, Exchange(1.0, 2.0, 2.0, 1.1)))
    assert events == []
    assert up.counts() == {"malformed": 2}
    assert up.said()["last refusal"].isprintable()


@pytest.mark.parametrize(
    ("size", "heard"),
    [((3840, 2160), True), ((64, 512), True), ((65535, 1), False), ((8, 65), False), ((16384, 16384), False)],
)
def test_what_a_device_tells_of_its_pictures_is_bounded(size: tuple[int, int], *, heard: bool) -> None:
    """The robot decodes, keeps and shows pictures of that size: 65535 x 1 was one of 14 GB for the pages."""
    up, _ = listening()
    camera = Camera("pinhole", *size, (max(size), max(size), size[0] / 2, size[1] / 2))
    up.take(names.key("eve", names.CAMERA_INFO), messages.camera_info(0.0, "", camera))
    assert list(up.calibrations(["eve"], 0.0)) == ["eve"] * heard
    assert up.counts() == ({} if heard else {"malformed": 1})
    assert heard or "--worn-camera FILE" in up.said()["last refusal"]


def test_only_devices_of_the_keys_are_listened_to() -> None:
    events: list[Event] = []
    up = Uplink(events.append, lambda: 7.0, devices=["anna"])
    for k in range(3000):
        send(up, f"eve{k}")
    assert up.counts() == {"too many devices": 6000}
    assert dict(up.received) == {}
    send(up, "anna")
    assert [e.session for e in events if isinstance(e, LiveView)] == ["anna/1"]


def test_who_is_awaited_has_a_place_beside_any_strangers() -> None:
    events: list[Event] = []
    up = Uplink(events.append, lambda: 7.0, awaited=["anna"])
    for k in range(100):
        send(up, f"eve{k}")
    send(up, "anna")
    assert "anna/1" in {e.session for e in events if isinstance(e, LiveView)}
    assert len(up.reports()) == len(up.received) == uplink.STRANGERS + 1


def test_more_than_the_rates_allow_is_dropped() -> None:
    up, events = listening()
    for k in range(1000):
        up.take(names.key("eve", names.IMAGE), messages.compressed_image(float(k), "eve/1", JPEG))
    assert up.counts()["too many"] >= 900
    send(up, "anna")
    assert len(events) == 1


def test_too_many_devices_are_not_listened_to() -> None:
    up, events = listening()
    send(up, "anna")
    for k in range(100):
        send(up, f"eve{k}")
    send(up, "anna", 8.0)
    assert up.counts()["too many devices"] == 2 * (100 - uplink.STRANGERS + 1)
    assert [e.session for e in events if isinstance(e, LiveView)].count("anna/1") == 2


@pytest.fixture
def address() -> link.Address:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return link.Address("127.0.0.1", s.getsockname()[1])


@pytest.fixture
def crowd(address: link.Address) -> Iterator[list[socket.socket]]:
    """Connections that say nothing, or rubbish."""
    open_ones: list[socket.socket] = []
    yield open_ones
    for one in open_ones:
        one.close()


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keys")
    make_keys(folder, hosts=["127.0.0.1"], devices=["anna", "berta"])
    return folder


@pytest.mark.parametrize("secured", [False, True])
def test_a_thousand_connections_do_not_shut_a_device_out(
    address: link.Address, crowd: list[socket.socket], keys: Path, *, secured: bool
) -> None:
    heard: list[bytes] = []
    of = {name: Keys.read(keys / name) if secured else None for name in ("robot", "anna")}
    with link.open_robot(address, of["robot"]) as robot, link.open_device(address, of["anna"]) as device:
        kept = link.subscriber(robot, f"{names.WORN}/**", lambda key, data: heard.append(data))
        assert connects(device)
        anna = names.key("anna", names.IMAGE)
        assert until(lambda: device.put(anna, b"first") or heard)
        for k in range(1000):
            one = socket.socket()
            one.setblocking(False)
            one.connect_ex((address.host, address.port))
            crowd.append(one)
            if k % 100 == 0:
                before = heard.count(b"during")
                assert until(lambda n=before: device.put(anna, b"during") or heard.count(b"during") > n)
        for one in crowd[:200]:
            with contextlib.suppress(OSError):
                one.send(b"GET / HTTP/1.1\r\n\r\n" * 10)
        assert until(lambda: device.put(anna, b"last") or b"last" in heard)
        if not secured:  # nothing but this port leads to the robot
            for one in crowd:
                one.close()
        with link.open_device(address, Keys.read(keys / "berta") if secured else None) as other:
            assert connects(other)
            key = names.key("berta", names.IMAGE)
            assert until(lambda: other.put(key, b"another") or b"another" in heard)
        kept.undeclare()


def connects(session: Any) -> bool:
    return until(lambda: connected(session))

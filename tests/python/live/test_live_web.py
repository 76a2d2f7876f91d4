"""The pages' server: who gets in, what a phone sends to the robot, what a page is told."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import socket
import ssl
import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("cryptography", reason="the extra live is not installed")
pytest.importorskip("websockets", reason="the extra live is not installed")

from helpers.waiting import LONGEST, connected, until
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from collabslam import Camera
from collabslam.live import link, messages, names
from collabslam.live.gateway import Gateway, seen_from_above
from collabslam.live.keys import make_keys
from collabslam.live.monotonic_clock import MonotonicClock
from collabslam.live.web import CONNECTIONS, HELLO, STRANGERS, Tokens, WebServer

TOKENS = Tokens("phone-token", "view-token")
SIZE = (640, 480)
CAMERA = Camera("pinhole", *SIZE, (500.0, 500.0, 320.0, 240.0))


class Robot:
    """What a robot hears and answers, without a filter."""

    def __init__(self, session: Any) -> None:
        self.clock = MonotonicClock(50.0)
        self.heard: list[tuple[str, bytes]] = []
        self._kept = [
            link.subscriber(session, names.ALL_WORN, lambda key, data: self.heard.append((key, data))),
            session.declare_queryable(names.CLOCK, self._tell),
        ]
        self.status = link.publisher(session, names.STATUS)
        self.pose = link.publisher(session, names.POSE)
        self.view = link.publisher(session, names.VIEW)

    def close(self) -> None:
        """It is dead."""
        for kept in (*self._kept, self.status, self.pose, self.view):
            kept.undeclare()

    def _tell(self, query: Any) -> None:
        query.reply(names.CLOCK, messages.times("robot", [self.clock.now(), self.clock.now()]))

    def of(self, part: str) -> list[bytes]:
        return [data for key, data in self.heard if key == names.key("web", part)]


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keys")
    make_keys(folder, hosts=[], devices=[], web_hosts=["127.0.0.1"])
    return folder


@pytest.fixture
def robot() -> Iterator[tuple[Robot, Gateway]]:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        address = link.Address("127.0.0.1", s.getsockname()[1])
    with link.open_robot(address, None) as session, link.open_device(address, None) as device:
        robot = Robot(session)
        gateway = Gateway(device, "web", CAMERA)
        assert until(lambda: connected(device))
        yield robot, gateway


def trusting(keys: Path) -> ssl.SSLContext:
    return ssl.create_default_context(cafile=str(keys / "web" / "authority.pem"))


def served(gateway: Gateway, keys: Path, visit: Any) -> Any:
    """What ``visit(port, context)`` gives while the pages are served."""

    async def both() -> Any:
        async with WebServer(gateway, TOKENS).serving("127.0.0.1", 0, keys / "web") as port:
            return await asyncio.wait_for(visit(port, trusting(keys)), LONGEST)

    return asyncio.run(both())


def open_socket(port: int, context: ssl.SSLContext, role: str, origin: str | None = None) -> Any:
    return connect(
        f"wss://127.0.0.1:{port}/{role}",
        ssl=context,
        origin=origin or f"https://127.0.0.1:{port}",
        close_timeout=1.0,  # it waits for what the server has still to say
    )


def picture(size: tuple[int, int] = SIZE) -> bytes:
    noise = np.random.default_rng(0).integers(0, 255, (size[1] // 8, size[0] // 8), np.uint8)
    return bytes(cv2.imencode(".jpg", cv2.resize(noise, size))[1])


def test_a_phone_is_a_worn_camera(robot: tuple[Robot, Gateway], keys: Path) -> None:
    there, gateway = robot
    off = 1000.0  # the phone's clock is so much ahead of the gateway's

    async def visit(port: int, context: ssl.SSLContext) -> tuple[float, float]:
        began = gateway.clock.now()
        async with open_socket(port, context, "phone") as page:
            await page.send(json.dumps({"token": TOKENS.phone, "width": SIZE[0], "height": SIZE[1]}))
            assert json.loads(await page.recv()) == {"ready": True}
            for _ in range(8):
                await page.send(json.dumps({"ask": gateway.clock.now() + off}))
                answer = {}
                while "asked" not in answer:
                    answer = json.loads(await page.recv())
                back = gateway.clock.now() + off
                times = [answer["asked"], answer["received"], answer["answered"], back]
                await page.send(json.dumps({"exchange": times}))
            taken = gateway.clock.now() + off
            await page.send(struct.pack(">d", taken) + picture())
            await page.send("no object")
            await page.send(b"short")
            while len(there.of(names.IMAGE)) < 2 or len(there.of(names.EXCHANGE)) < 3:
                await asyncio.sleep(0.05)  # what comes at once is held to be a flood
                await page.send(struct.pack(">d", taken + 1.0) + picture())  # behind what is not an image
            return taken, gateway.clock.now() - began

    taken, lasted = served(gateway, keys, visit)
    image, *later = [messages.decoded(messages.COMPRESSED, data) for data in there.of(names.IMAGE)]
    assert messages.stamp_of(image) == pytest.approx(taken, abs=1e-6)
    assert [messages.stamp_of(other) for other in later] == pytest.approx(
        [taken + 1.0] * len(later), abs=1e-6
    )
    assert image.data.tobytes() == picture()
    exchanges = [messages.exchange_from(data) for data in there.of(names.EXCHANGE)]
    assert len(exchanges) >= 3  # the first ones may be before the link is there
    assert {session for session, _ in exchanges} == {image.header.frame_id}
    before, now_at_robot, after = gateway.clock.now(), there.clock.now(), gateway.clock.now()
    expected = now_at_robot - (0.5 * (before + after) + off)
    for _, exchange in exchanges:  # one can be wrong by half of what it took, however busy the machine
        assert abs(exchange.offset - expected) <= 0.5 * (lasted + after - before)
    assert messages.camera_from(there.of(names.CAMERA_INFO)[0], "test").width == SIZE[0]


def test_a_phone_that_tracks_itself_tells_its_calibration_and_its_way(
    robot: tuple[Robot, Gateway], keys: Path
) -> None:
    there, gateway = robot
    numbers = [400.0, 410.0, 200.0, 300.0]
    turn = [0.0, np.sin(0.2), 0.0, np.cos(0.2)]

    async def visit(port: int, context: ssl.SSLContext) -> list[Any]:
        said = []
        left = [numbers, [400.0, -1.0, 2.0, "x"], [1.0]]
        while left:
            async with open_socket(port, context, "phone") as page:
                hello = {"token": TOKENS.phone, "width": 401, "height": 601, "intrinsics": left[0]}
                await page.send(json.dumps(hello))
                answer = json.loads(await page.recv())
                if "Another phone" in answer.get("refused", ""):  # the one before has not gone yet
                    continue
                said.append(answer)
                del left[0]
                if "ready" not in answer:
                    continue
                await page.send(json.dumps({"own": [7.5, 1.0, 2.0, 3.0, *turn]}))
                await page.send(json.dumps({"own": [7.5, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0]}))  # no turn
                await page.send(json.dumps({"own": [7.5, 1.0]}))
                await page.send(json.dumps({"exchange": [1.0, 2.0, 2.0, 1.1]}))
                while not there.of(names.OWN) or not there.of(names.CAMERA_INFO):
                    await asyncio.sleep(0.05)
        return said

    said = served(gateway, keys, visit)
    assert said[0] == {"ready": True}
    assert all("plain camera" in answer["refused"] for answer in said[1:])
    (own,) = there.of(names.OWN)
    t, t_xf, covariance = messages.pose_from(own, "test")
    assert t == 7.5
    np.testing.assert_allclose(t_xf[:3, 3], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(t_xf[:3, 2], [-np.sin(0.4), 0.0, -np.cos(0.4)], atol=1e-12)  # looks along -z
    np.testing.assert_allclose(t_xf[:3, 1], [0.0, -1.0, 0.0], atol=1e-12)  # its y is down
    assert np.linalg.eigvalsh(covariance)[0] > 0.0
    camera = messages.camera_from(there.of(names.CAMERA_INFO)[0], "test")
    assert [camera.width, camera.height, *camera.intrinsics] == [401, 601, *numbers]


def test_a_phone_tells_how_it_turns(robot: tuple[Robot, Gateway], keys: Path) -> None:
    there, gateway = robot
    rows = [[7.0, 0.1, -0.2, 0.3], [7.01, 0.2, -0.2, 0.3]]
    bad = [[7.02, 1e400, 0.0, 0.0], [7.03, "x", 0.0, 0.0], [7.04, 0.0], "x", None]

    async def visit(port: int, context: ssl.SSLContext) -> None:
        async with open_socket(port, context, "phone") as page:
            await page.send(json.dumps({"token": TOKENS.phone, "width": SIZE[0], "height": SIZE[1]}))
            assert json.loads(await page.recv()) == {"ready": True}
            await page.send(json.dumps({"rates": [[1.0, 0.0, 0.0, 0.0]] * 26}))  # more than come at once
            await page.send(json.dumps({"rates": 3}))
            for k in range(40):
                await page.send(json.dumps({"rates": [*bad, *([t + k, *w] for t, *w in rows)]}))
                await asyncio.sleep(0.05)
                if len(there.of(names.RATE)) >= 2:
                    break

    served(gateway, keys, visit)
    samples = [messages.decoded(messages.IMU, data) for data in there.of(names.RATE)]
    for sample in samples:
        row = rows[round(100.0 * (messages.stamp_of(sample) % 1.0))]
        np.testing.assert_array_equal(messages.rate_of(sample), row[1:])
        assert str(sample.header.frame_id).startswith("web/")
    assert len(samples) >= 2


def test_a_page_is_told_what_the_robot_says(robot: tuple[Robot, Gateway], keys: Path) -> None:
    there, gateway = robot

    heard = threading.Event()

    def speak() -> None:
        for k in itertools.count():
            if heard.is_set():
                return
            pose = np.eye(4)
            pose[:3, 3] = (0.1 * k, 0.0, 0.2 * k)
            there.pose.put(messages.robot_pose(float(k), pose, np.diag([1e-4] * 6)))
            entries = {
                "robot": ("OK", "OK", {"link": "collab", "map_size": 7}),
                "web": ("OK", "", {"age_ms": 12}),
            }
            there.status.put(messages.status(float(k), entries))
            there.view.put(messages.compressed_image(float(k), "cs", picture((64, 48))))
            time.sleep(0.05)

    async def visit(port: int, context: ssl.SSLContext) -> tuple[dict[str, Any], list[bytes]]:
        told: dict[str, Any] = {}
        pictures: list[bytes] = []
        async with open_socket(port, context, "view") as page:
            await page.send(json.dumps({"token": TOKENS.view}))
            thread = threading.Thread(target=speak, daemon=True)
            thread.start()
            while not pictures or told.get("point", [0.0])[0] < 1.0:
                message = await page.recv()
                if isinstance(message, bytes):
                    pictures.append(message)
                else:
                    told |= json.loads(message)
            heard.set()
            await asyncio.to_thread(thread.join)
        return told, pictures

    told, pictures = served(gateway, keys, visit)
    assert told["status"] == "OK"
    assert told["link"] == "collab"
    assert told["facts"] == {"link": "collab", "map size": "7", "web: age ms": "12"}
    assert told["point"][1] == pytest.approx(2.0 * told["point"][0])
    assert pictures[0] == picture((64, 48))


@pytest.mark.parametrize(
    ("role", "hello"),
    [
        ("phone", {"token": TOKENS.view}),
        ("view", {"token": TOKENS.phone}),
        ("view", {"token": 7}),
        ("view", {}),
        ("view", ["token"]),
        ("view", {"token": "\ud800"}),
        ("phone", {"token": "\ud800", "watch": True}),
        ("phone", {"token": TOKENS.phone + "\0"}),
        ("phone", {"token": 10**300}),
    ],
)
def test_without_its_token_a_page_gets_nothing(
    robot: tuple[Robot, Gateway], keys: Path, role: str, hello: Any
) -> None:
    async def visit(port: int, context: ssl.SSLContext) -> int | None:
        async with open_socket(port, context, role) as page:
            await page.send(json.dumps(hello))
            with pytest.raises(ConnectionClosed):
                await page.recv()
            return page.close_code

    assert served(robot[1], keys, visit) == 1008


def test_facts_are_told_once_and_how_long_the_robot_is_silent(
    robot: tuple[Robot, Gateway], keys: Path
) -> None:
    """A robot that is killed: nothing of it is told again, but how long that was ago."""
    there, gateway = robot

    async def visit(port: int, context: ssl.SSLContext) -> list[dict[str, Any]]:
        told: list[dict[str, Any]] = []
        async with open_socket(port, context, "view") as page:
            await page.send(json.dumps({"token": TOKENS.view}))
            assert json.loads(await page.recv()) == {"ages": {}}
            while not any(message.get("status") == "OK" for message in told):
                there.status.put(messages.status(1.0, {"robot": ("OK", "OK", {"link": "mono"})}))
                told.append(json.loads(await page.recv()))
            there.close()
            while told[-1]["ages"]["status"] < 2.5:
                told.append(json.loads(await page.recv()))
        return told

    told = served(gateway, keys, visit)
    last = max(k for k, message in enumerate(told) if "status" in message)
    assert len(told) > last + 2
    assert all(set(message) == {"ages"} for message in told[last + 1 :])
    ages = [message["ages"]["status"] for message in told[last + 1 :]]
    assert ages == sorted(ages)


def test_a_phone_sees_what_the_robot_sees_before_its_start(robot: tuple[Robot, Gateway], keys: Path) -> None:
    there, gateway = robot

    async def visit(port: int, context: ssl.SSLContext) -> tuple[bytes, dict[str, Any]]:
        async with open_socket(port, context, "phone") as page:
            await page.send(json.dumps({"token": TOKENS.phone, "watch": True}))
            found: bytes | None = None
            while found is None:
                there.view.put(messages.compressed_image(1.0, "cs", picture((64, 48))))
                message = await page.recv()
                found = message if isinstance(message, bytes) else None
            async with open_socket(port, context, "phone") as other:  # it takes nobody's place
                await other.send(json.dumps({"token": TOKENS.phone, "width": SIZE[0], "height": SIZE[1]}))
                return found, json.loads(await other.recv())

    seen, answer = served(gateway, keys, visit)
    assert seen == picture((64, 48))
    assert answer == {"ready": True}


def test_a_phone_is_told_what_becomes_of_its_images(robot: tuple[Robot, Gateway], keys: Path) -> None:
    there, gateway = robot

    async def visit(port: int, context: ssl.SSLContext) -> list[dict[str, Any]]:
        said: list[dict[str, Any]] = []
        async with open_socket(port, context, "phone") as page:
            await page.send(json.dumps({"token": TOKENS.phone, "width": SIZE[0], "height": SIZE[1]}))
            for k in itertools.count(1):
                own = {"images": 10 * k, "dropped no pose": 8 * k}
                entries = {"robot": ("OK", "OK", {"link": "mono"}), "web": ("OK", "", own)}
                there.status.put(messages.status(float(k), entries))
                message = await page.recv()
                said += [] if isinstance(message, bytes) or "own" not in message else [json.loads(message)]
                if said and "tag" in said[-1]["own"]["text"]:
                    return said
        return said

    assert served(gateway, keys, visit)[-1]["own"]["good"] is False


def test_who_shows_no_token_holds_no_place(robot: tuple[Robot, Gateway], keys: Path) -> None:
    """More than may be there at all, and all of them silent: a page with its token gets in."""

    async def visit(port: int, context: ssl.SSLContext) -> dict[str, Any]:
        async with contextlib.AsyncExitStack() as stack:
            for _ in range(STRANGERS + 20):
                await stack.enter_async_context(open_socket(port, context, "view"))
            page = await stack.enter_async_context(open_socket(port, context, "view"))
            await page.send(json.dumps({"token": TOKENS.view}))
            return dict(json.loads(await page.recv()))

    assert "ages" in served(robot[1], keys, visit)


@pytest.mark.parametrize("said", [b"", b"\x16\x03\x01\x00\xff", b"GET / HTTP/1.1\r\n"])
def test_who_is_silent_before_any_encryption_holds_no_place(
    robot: tuple[Robot, Gateway], keys: Path, said: bytes
) -> None:
    """The oldest are sent away at once, not after their seconds, and a page with its token gets in."""

    async def visit(port: int, context: ssl.SSLContext) -> dict[str, Any]:
        crowd = [await asyncio.open_connection("127.0.0.1", port) for _ in range(STRANGERS + 20)]
        for _, writer in crowd:
            writer.write(said)
        async with open_socket(port, context, "view") as page:
            await page.send(json.dumps({"token": TOKENS.view}))
            answer = dict(json.loads(await page.recv()))
        with contextlib.suppress(ConnectionError):
            assert len(await asyncio.wait_for(crowd[0][0].read(), HELLO / 2)) < 100
        for _, writer in crowd:
            writer.close()
        return answer

    assert "ages" in served(robot[1], keys, visit)


def test_so_many_pages_and_no_more(robot: tuple[Robot, Gateway], keys: Path) -> None:
    async def visit(port: int, context: ssl.SSLContext) -> tuple[list[bool], int | None]:
        async with contextlib.AsyncExitStack() as stack:
            seen = []
            for _ in range(CONNECTIONS):
                page = await stack.enter_async_context(open_socket(port, context, "view"))
                await page.send(json.dumps({"token": TOKENS.view}))
                seen.append("ages" in json.loads(await page.recv()))
            page = await stack.enter_async_context(open_socket(port, context, "view"))
            await page.send(json.dumps({"token": TOKENS.view}))
            with pytest.raises(ConnectionClosed):
                await page.recv()
            return seen, page.close_code

    assert served(robot[1], keys, visit) == ([True] * CONNECTIONS, 1008)


def test_more_connections_than_files_are_no_news(
    robot: tuple[Robot, Gateway], keys: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def visit(port: int, context: ssl.SSLContext) -> None:
        loop = asyncio.get_running_loop()
        for error in (OSError(24, "Too many open files"), KeyError("ours")):
            loop.call_exception_handler({"message": str(error), "exception": error})

    served(robot[1], keys, visit)
    assert [record.message.partition("\n")[0] for record in caplog.records] == ["'ours'"]


HANDSHAKES = {
    "two hosts": "Host: 127.0.0.1\r\nHost: elsewhere\r\nOrigin: https://127.0.0.1\r\n",
    "no host": "Origin: https://127.0.0.1\r\n",
    "two origins": "Host: 127.0.0.1\r\nOrigin: https://127.0.0.1\r\nOrigin: https://elsewhere\r\n",
    "no origin": "Host: 127.0.0.1\r\n",
    "origin null": "Host: 127.0.0.1\r\nOrigin: null\r\n",
    "bytes": "Host: 127.0.0.1\r\nOrigin: https://\xff\xfe\r\n",
    "upgrade twice": "Host: a\r\nHost: b\r\nUpgrade: h2c\r\n",
}


@pytest.mark.parametrize("name", list(HANDSHAKES))
def test_a_handshake_of_nobody_is_refused_without_a_word(
    robot: tuple[Robot, Gateway], keys: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    async def visit(port: int, context: ssl.SSLContext) -> bytes:
        reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
        key = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        key += "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        writer.write(f"GET /view HTTP/1.1\r\n{HANDSHAKES[name]}{key}\r\n".encode("latin-1"))
        head = await reader.read(100)
        writer.close()
        return head

    head = served(robot[1], keys, visit)
    assert b" 101 " not in head
    assert "Traceback" not in "".join(capfd.readouterr())


FOREIGN: list[Any] = [
    struct.pack(">d", 3e9) + b"\xff\xd8\xff",
    struct.pack(">d", -3e9) + b"\xff\xd8\xff",
    struct.pack(">d", float("nan")) + b"\xff\xd8\xff",
    struct.pack(">d", float("inf")) + b"\xff\xd8\xff",
    b"",
    bytes(7),
    "",
    "[" * 10_000,
    json.dumps({"ask": 10**400}),
    json.dumps({"ask": 3e9}),
    json.dumps({"ask": True}),
    '{"ask": NaN}',
    '{"ask": Infinity}',
    json.dumps({"exchange": [1.0, 2.0]}),
    json.dumps({"exchange": [10**300] * 4}),
    json.dumps({"exchange": "abcd"}),
    json.dumps({"exchange": {"a": 1}}),
    json.dumps({"own": [3e9, *[0.0] * 6, 1.0]}),
    json.dumps({"own": [1.0, *[1e308] * 7]}),
    json.dumps({"own": [1.0, *[0.0] * 7]}),
    json.dumps({"own": [[1.0]] * 8}),
    json.dumps({"ask": {}, "exchange": None, "own": 7}),
    '{"a": "\\ud800"}',
]


@pytest.mark.parametrize("k", range(len(FOREIGN)))
def test_a_phone_that_says_anything_costs_only_itself(
    robot: tuple[Robot, Gateway], keys: Path, k: int, capfd: pytest.CaptureFixture[str]
) -> None:
    async def visit(port: int, context: ssl.SSLContext) -> bool:
        async with open_socket(port, context, "phone") as page:
            await page.send(json.dumps({"token": TOKENS.phone, "width": SIZE[0], "height": SIZE[1]}))
            await page.recv()
            await page.send(FOREIGN[k])
            await page.send(json.dumps({"ask": 1.0}))
            answer: dict[str, Any] = {}
            while "asked" not in answer or answer["asked"] != 1.0:
                answer = json.loads(await page.recv())
        return True

    assert served(robot[1], keys, visit)
    assert robot[0].of(names.IMAGE) == []
    assert "Traceback" not in "".join(capfd.readouterr())


def test_another_site_and_large_messages_are_refused(robot: tuple[Robot, Gateway], keys: Path) -> None:
    async def visit(port: int, context: ssl.SSLContext) -> int | None:
        with pytest.raises(InvalidStatus, match="403"):
            async with open_socket(port, context, "view", origin="https://elsewhere.example"):
                pass
        async with open_socket(port, context, "phone") as page:
            await page.send(json.dumps({"token": TOKENS.phone, "width": SIZE[0], "height": SIZE[1]}))
            await page.recv()
            await page.send(bytes(1_000_000))
            await page.wait_closed()
            return page.close_code

    there, gateway = robot
    assert served(gateway, keys, visit) == 1009
    assert there.of(names.IMAGE) == []


def test_a_phone_of_another_size_or_a_second_one_is_told_why(
    robot: tuple[Robot, Gateway], keys: Path
) -> None:
    async def visit(port: int, context: ssl.SSLContext) -> list[str]:
        said = []
        async with open_socket(port, context, "phone") as first:
            await first.send(json.dumps({"token": TOKENS.phone, "width": SIZE[0], "height": SIZE[1]}))
            await first.recv()
            async with open_socket(port, context, "phone") as second:
                await second.send(json.dumps({"token": TOKENS.phone, "width": SIZE[0], "height": SIZE[1]}))
                said.append(json.loads(await second.recv())["refused"])
        while len(said) < 2 or "Another phone" in said[1]:  # until the first has gone
            async with open_socket(port, context, "phone") as turned:
                await turned.send(json.dumps({"token": TOKENS.phone, "width": SIZE[1], "height": SIZE[0]}))
                said[1:] = [json.loads(await turned.recv())["refused"]]
        return said

    second, turned = served(robot[1], keys, visit)
    assert "Another phone" in second
    assert "480 x 640" in turned


def test_the_pages_are_served_with_their_rules(robot: tuple[Robot, Gateway], keys: Path) -> None:
    async def visit(port: int, context: ssl.SSLContext) -> dict[str, tuple[str, str]]:
        found = {}
        for path in (
            "/",
            "/view",
            "/page.css",
            "/phone.js",
            "/tracked.js",
            "/view.js",
            "/link.js",
            "/key.pem",
            "/../web.py",
        ):
            reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
            writer.write(
                f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n".encode()
            )
            head, _, body = (await reader.read()).decode().partition("\r\n\r\n")
            found[path] = (head, body)
            writer.close()
        return found

    found = served(robot[1], keys, visit)
    status = {path: head.split()[1] for path, (head, _) in found.items()}
    assert set(status.values()) == {"200", "404"}
    assert {path for path, s in status.items() if s == "404"} == {"/key.pem", "/../web.py"}
    assert "Content-Security-Policy: default-src 'self'" in found["/"][0]
    assert "requestVideoFrameCallback" in found["/phone.js"][1]


def test_the_ellipse_lies_along_the_larger_deviation() -> None:
    pose = np.eye(4)
    covariance = np.diag([0.01, 1.0, 0.04, 1.0, 1.0, 1.0])
    x, z, a, b, angle, heading = seen_from_above(pose, covariance)
    assert (x, z) == (0.0, 0.0)
    assert heading == pytest.approx(np.pi / 2, abs=1e-3)  # along z
    assert (a, b) == (0.2, 0.1)
    assert abs(angle) == pytest.approx(np.pi / 2, abs=1e-3)


def test_a_thousand_connections_do_not_disturb_an_open_page(robot: tuple[Robot, Gateway], keys: Path) -> None:
    there, gateway = robot

    async def visit(port: int, context: ssl.SSLContext) -> tuple[str, int]:
        crowd: list[socket.socket] = []
        async with open_socket(port, context, "view") as page:
            await page.send(json.dumps({"token": TOKENS.view}))
            for k in range(1000):
                one = socket.socket()
                one.setblocking(False)
                one.connect_ex(("127.0.0.1", port))
                if k % 2:
                    with contextlib.suppress(OSError):
                        one.send(b"GET / HTTP/1.1\r\n\r\n")
                crowd.append(one)
            told: dict[str, Any] = {}
            while told.get("status") != "OK":
                there.status.put(messages.status(1.0, {"robot": ("OK", "OK", {"link": "mono"})}))
                message = await page.recv()
                told |= {} if isinstance(message, bytes) else json.loads(message)
            for one in crowd:
                one.close()
        _, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
        writer.close()
        return told["status"], len(crowd)

    assert served(gateway, keys, visit) == ("OK", 1000)

"""Robot and worn camera on a link: who may write what, and what comes out at the other end."""

from __future__ import annotations

import datetime
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("cryptography", reason="the extra live is not installed")

from helpers.driven import T_BC, Driven, wheels
from helpers.in_step import Behind, InStep
from helpers.waiting import LONGEST, connected, until

from collabslam import DataError, Settings, SettingsError
from collabslam.datasets import write_recording
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.live import link, messages, names
from collabslam.live.cameras import RecordingPlayback
from collabslam.live.core import OdometrySample, RobotFrame
from collabslam.live.keys import Keys, make_keys
from collabslam.live.link import Address
from collabslam.live.record import EventReader
from collabslam.live.replay import replay
from collabslam.live.results import ENGINE
from collabslam.live.robot import RobotNode, RobotOptions
from collabslam.live.slam import BOUNDS
from collabslam.live.worn import WornDevice
from collabslam.types import Frame, Image

LEAST = BOUNDS[RobotFrame]
"""Frames that are done however busy the machine is: as many wait."""


class Held(WrappedRecording):
    """The clip as a recording, its last frame some seconds later."""

    def __init__(self, clip: Clip, pause: float = 0.0) -> None:
        super().__init__(clip.recording)
        last = clip.frames[-1]
        self._frames = [*clip.frames[:-1], replace(last, t=last.t + pause)]
        self.times = np.array([f.t for f in self._frames])

    def __len__(self) -> int:
        return len(self._frames)

    def frame(self, i: int) -> Frame:
        return self._frames[i]

    def image(self, i: int) -> Image:
        return self._frames[i].image


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keys")
    make_keys(folder, hosts=["127.0.0.1"], devices=["anna", "berta"])
    return folder


@pytest.fixture
def address() -> Address:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return Address("127.0.0.1", s.getsockname()[1])


@pytest.mark.slow
def test_live_over_the_link_and_its_record_again(
    clip: Clip, folder: Path, address: Address, tmp_path: Path
) -> None:
    recording = Held(clip)
    options = RobotOptions(tmp_path / "live", Settings.default(), record=tmp_path / "record")
    summaries = []
    with link.open_robot(address, Keys.read(folder / "robot")) as session:
        played = InStep(recording)
        node = RobotNode(session, played, options)
        played.follow(node, "anna")
        robot = threading.Thread(target=lambda: summaries.append(node.run()))
        with link.open_device(address, Keys.read(folder / "anna")) as at_device:
            assert until(lambda: connected(at_device))
            robot.start()
            assert clip.recording.worn_camera is not None
            camera = RecordingPlayback(recording)
            camera.clock = Behind(played, 100.0)
            poses: list[bytes] = []
            heard = link.subscriber(at_device, names.POSE, lambda key, data: poses.append(data))
            with WornDevice(at_device, "anna", clip.recording.worn_camera, camera.clock) as device:
                InStep.send(device, camera, robot)
            heard.undeclare()
    (summary,) = summaries
    assert summary["frames"] == len(recording)
    assert summary["links"]["collab"] >= len(recording) - 2  # Cf does not see what the last frame shows
    assert summary["statuses"]["OK"] >= len(recording) - 1
    assert len(poses) >= len(recording) - 1
    t, pose, covariance = messages.pose_from(poses[-1], "test")
    assert t in recording.times
    assert np.isfinite(pose).all()
    assert np.linalg.eigvalsh(covariance)[0] > 0.0
    again = replay(tmp_path / "record", tmp_path / "again")
    assert again["frames"] == summary["frames"]
    for name in ("trajectory.tum", "trajectory.cov"):
        live = (tmp_path / "live" / name).read_bytes()
        assert live.count(b"\n") > 10
        assert (tmp_path / "again" / name).read_bytes() == live
    kept = json.loads((tmp_path / "live" / "summary.json").read_text())
    assert kept["links"] == summary["links"]


@pytest.mark.slow
def test_a_robot_follows_the_odometry_that_comes_with_its_images(
    clip: Clip, address: Address, tmp_path: Path
) -> None:
    odometry = wheels(clip)
    options = RobotOptions(
        tmp_path / "live", Settings.default(), mode="mono", start="odometry", record=tmp_path / "record"
    )
    with link.open_robot(address, None) as session:
        played = InStep(Driven(clip, odometry))
        node = RobotNode(session, played, options)
        played.follow(node)
        summary = node.run()
    assert summary["frames"] == len(clip.frames)
    reader = EventReader(tmp_path / "record")
    samples = [event for event in reader.events() if isinstance(event, OdometrySample)]
    assert len(samples) >= len(odometry.times) - 10
    np.testing.assert_allclose(np.reshape(reader.plan.t_bc, (4, 4)), T_BC)
    again = replay(tmp_path / "record", tmp_path / "again")
    assert again["frames"] == summary["frames"]
    told = [(tmp_path / run / "trajectory.tum").read_bytes() for run in ("live", "again")]
    assert told[0] == told[1]
    assert told[0].count(b"\n") > 5


@pytest.fixture
def robot(folder: Path, address: Address) -> Iterator[list[tuple[str, int]]]:
    """What a robot with keys hears."""
    heard: list[tuple[str, int]] = []
    with link.open_robot(address, Keys.read(folder / "robot")) as session:
        taken = [
            link.subscriber(session, f"{above}/**", lambda key, data: heard.append((key, len(data))))
            for above in (names.WORN, names.ROBOT)
        ]
        yield heard
        for subscriber in taken:
            subscriber.undeclare()


def test_a_device_writes_its_own_keys_only(
    folder: Path, address: Address, robot: list[tuple[str, int]]
) -> None:
    with link.open_device(address, Keys.read(folder / "berta")) as session:
        assert until(lambda: connected(session))
        others = [names.key("anna", names.IMAGE), names.POSE, names.STATUS, "collabslam/worn/anna"]
        below = ["anna/image", "another", "image/anna", "*", "**", "im$*"]
        others += [f"{names.WORN}/berta/{part}" for part in below] + [f"{names.WORN}/*/image"]
        for key in others:
            session.put(key, b"x" * 1000)
        own = names.key("berta", names.IMAGE)
        assert until(lambda: session.put(own, b"x" * 1000) or robot)  # what was put before would be there
    assert set(robot) == {(own, 1000)}


def test_a_device_neither_hears_nor_answers_for_another(
    folder: Path, address: Address, robot: list[tuple[str, int]]
) -> None:
    """Whatever it asks to hear or claims to answer, and however it packs what is too large."""
    overheard: list[str] = []
    with (
        link.open_device(address, Keys.read(folder / "anna")) as anna,
        link.open_device(address, Keys.read(folder / "berta")) as berta,
    ):
        assert until(lambda: connected(anna) and connected(berta))
        kept = [
            berta.declare_subscriber(key, lambda sample: overheard.append(str(sample.key_expr)))
            for key in ("**", names.key("anna", names.IMAGE), names.ALL_WORN)
        ]
        claimed = [
            berta.declare_queryable(key, lambda query: query.reply(names.CLOCK, b"mine"))
            for key in (names.CLOCK, "collabslam/**")
        ]
        berta.put(names.key("berta", names.T_CF), b"x", attachment=bytes(2 * link.LARGEST_PUT))
        own = names.key("anna", names.IMAGE)
        assert until(lambda: anna.put(own, b"x" * 1000) or robot)
        assert [reply for reply in anna.get(names.CLOCK, timeout=1.0) if reply.ok] == []
        for one in (*kept, *claimed):
            one.undeclare()
    assert set(robot) == {(own, 1000)}
    assert own not in overheard, "it hears itself alone"


def test_images_go_as_datagrams_and_the_rest_does_not(
    folder: Path, address: Address, robot: list[tuple[str, int]]
) -> None:
    """Both links are of one device, and it writes its own keys only by either of them."""
    with link.open_device(address, Keys.read(folder / "berta")) as session:
        assert until(lambda: len(list(session.info.links())) == 2)
        kinds = {str(of.reliability).rpartition(".")[2] for of in session.info.links()}
        assert kinds == {"BEST_EFFORT", "RELIABLE"}
        for datagrams in (True, False):
            image = bytes(10_000 + datagrams)
            others, own = (
                link.publisher(session, names.key(device, names.IMAGE), datagrams=datagrams)
                for device in ("anna", "berta")
            )

            def arrives(out: Any = own, image: bytes = image) -> bool:
                """What comes at once is held to be a flood, and a datagram may be lost: it is put again."""
                out.put(image)
                return len(image) in [size for _, size in robot]

            others.put(image)
            assert until(arrives)
    assert set(robot) == {(names.key("berta", names.IMAGE), n) for n in (10_000, 10_001)}


def test_a_message_that_is_too_large_does_not_arrive(
    folder: Path, address: Address, robot: list[tuple[str, int]]
) -> None:
    with link.open_device(address, Keys.read(folder / "anna")) as session:
        assert until(lambda: connected(session))
        session.put(names.key("anna", names.IMAGE), bytes(link.LARGEST_PUT + 1000))

        def arrives() -> bool:
            """A put never waits: behind a large one, on a busy machine, it is dropped, so it is put again."""
            session.put(names.key("anna", names.T_CF), bytes(100))
            return bool(robot)

        assert until(arrives)
    assert set(robot) == {(names.key("anna", names.T_CF), 100)}


def test_a_foreign_certificate_and_none_are_refused(
    folder: Path, address: Address, robot: list[tuple[str, int]], tmp_path: Path
) -> None:
    make_keys(tmp_path, hosts=["127.0.0.1"], devices=["anna"])
    for keys in (Keys.read(tmp_path / "anna"), None):
        with link.open_device(address, keys) as session:
            session.put(names.key("anna", names.IMAGE), b"x")
            with link.open_device(address, Keys.read(folder / "berta")) as welcome:  # later than that
                key = names.key("berta", names.IMAGE)
                heard = len(robot)
                assert until(lambda w=welcome, k=key, n=heard: w.put(k, b"berta") or len(robot) > n)
            assert not connected(session)
            session.put(names.key("anna", names.IMAGE), b"x")
    assert {key for key, _ in robot} == {names.key("berta", names.IMAGE)}


def test_a_device_cannot_play_the_robot(address: Address, tmp_path: Path) -> None:
    """Though the robot's address is the very name in its certificate."""
    make_keys(tmp_path, hosts=["127.0.0.1"], devices=["anna", "localhost"])
    false = replace(Keys.read(tmp_path / "localhost"), devices=("anna",))
    for robot, is_found in ((false, False), (Keys.read(tmp_path / "robot"), True)):
        with (
            link.open_robot(address, robot),
            link.open_device(Address("localhost", address.port), Keys.read(tmp_path / "anna")) as device,
        ):
            assert until(lambda d=device: connected(d)) if is_found else not connects_soon(device)


def connects_soon(session: Any) -> bool:
    """Within some tries."""
    until_then = time.monotonic() + 6 * link.RETRY_MS / 1e3
    while time.monotonic() < until_then and not connected(session):
        time.sleep(0.05)
    return connected(session)


def of_another(name: str) -> Callable[[Path], object]:
    return lambda anna: shutil.copyfile(anna.parent / "other" / "anna" / name, anna / name)


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (of_another("key.pem"), "is of another certificate"),
        (of_another("authority.pem"), "is of another authority"),
        (lambda anna: (anna / "key.pem").write_bytes(b"\xff" * 100), "cannot be read"),
        (lambda anna: (anna / "authority.pem").write_bytes(b""), "cannot be read"),
        (lambda anna: os.truncate(anna / "authority.pem", 2 << 30), "2048 MB"),
    ],
)
def test_keys_that_do_not_belong_together_are_told(
    damage: Callable[[Path], object], told: str, tmp_path: Path
) -> None:
    """Or the device would wait for a robot that refuses it without a word."""
    for folder in (tmp_path, tmp_path / "other"):
        make_keys(folder, hosts=["127.0.0.1"], devices=["anna"])
    damage(tmp_path / "anna")
    with pytest.raises(DataError, match=told):
        Keys.read(tmp_path / "anna")


def test_a_clock_before_the_certificate_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_keys(tmp_path, hosts=["127.0.0.1"], devices=["anna"])

    class Early(datetime.datetime):
        @classmethod
        def now(cls, tz: datetime.tzinfo | None = None) -> datetime.datetime:
            return datetime.datetime(2001, 2, 3, tzinfo=tz)

    monkeypatch.setattr("collabslam.live.keys.datetime.datetime", Early)
    with pytest.raises(DataError, match="clock says 2001-02-03"):
        Keys.read(tmp_path / "anna")


def test_without_keys_only_this_machine_is_served(address: Address) -> None:
    with (
        pytest.raises(SettingsError, match="collabslam live keys"),
        link.open_robot(Address("0.0.0.0"), None),
    ):
        pass
    with pytest.raises(SettingsError, match="collabslam live keys"):
        link.keys_of(None, insecure=False)
    with link.open_robot(address, None), link.open_device(address, None) as session:
        assert until(lambda: connected(session))
    with pytest.raises(DataError, match="lacks"):
        Keys.read(Path("nowhere"))


def test_an_address_in_use_is_named(address: Address) -> None:
    refused = pytest.raises(DataError, match=str(address.port))
    with link.open_robot(address, None), refused, link.open_robot(address, None):
        pass


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("robot", "robot", names.PORT),
        ("10.0.0.2:99", "10.0.0.2", 99),
        ("[fe80::1]:99", "fe80::1", 99),
        ("[::1]", "::1", names.PORT),
    ],
)
def test_addresses(text: str, host: str, port: int) -> None:
    assert Address.parse(text) == Address(host, port)


def test_private_keys_are_private_and_made_once(folder: Path) -> None:
    before = (folder / "anna" / "key.pem").read_bytes()
    assert make_keys(folder, hosts=[], devices=["anna", "carl"]) == [folder / "carl"]
    assert (folder / "anna" / "key.pem").read_bytes() == before
    assert Keys.read(folder / "robot").devices == ("anna", "berta", "carl")
    assert {p.stat().st_mode & 0o077 for p in folder.rglob("*.key")} == {0}
    assert {p.stat().st_mode & 0o077 for p in folder.rglob("key.pem")} == {0}
    with pytest.raises(SettingsError, match="called"):
        make_keys(folder, hosts=[], devices=["../anna"])


@pytest.mark.parametrize(
    "host", ["", "ü", "a b", "x" * 300, "a\nb", "*", "robot:7447", "https://robot", "-a"]
)
def test_a_host_is_a_name_or_an_address(host: str, tmp_path: Path) -> None:
    for hosts, web in (([host], []), ([], [host])):
        with pytest.raises(SettingsError, match="neither a name nor an address"):
            make_keys(tmp_path, hosts=hosts, devices=["anna"], web_hosts=web)
    assert not list(tmp_path.iterdir())


def test_keys_of_nobody_open_no_robot(address: Address, tmp_path: Path) -> None:
    make_keys(tmp_path, hosts=["127.0.0.1", "my_robot.local", "::1"], devices=[])
    with (
        pytest.raises(SettingsError, match="name no device"),
        link.open_robot(address, Keys.read(tmp_path / "robot")),
    ):
        pass


@pytest.mark.parametrize("devices", ["anna/b\n", "**\n", "robot\n", "a" * 40])
def test_devices_of_a_damaged_folder_are_told(devices: str, tmp_path: Path) -> None:
    make_keys(tmp_path, hosts=["127.0.0.1"], devices=["anna"])
    (tmp_path / "robot" / "devices.txt").write_text(devices)
    with pytest.raises(DataError, match="cannot be read"):
        Keys.read(tmp_path / "robot")


@pytest.mark.slow
def test_a_robot_that_was_killed_goes_on_from_its_checkpoint(
    clip: Clip, address: Address, tmp_path: Path
) -> None:
    walk, out = write_recording(Held(clip), tmp_path / "walk"), tmp_path / "out"
    paused = write_recording(Held(clip, pause=LONGEST), tmp_path / "paused")
    command = [sys.executable, "-m", "collabslam", "live", "robot", "--insecure"]
    command += ["--listen", f"127.0.0.1:{address.port}", "--out", str(out), "--start", "scale-free"]
    command += ["--mode", "mono", "--checkpoint-every", "3"]
    process = subprocess.Popen([*command, str(paused)])
    assert until(lambda: (out / ENGINE).is_file() and lines(out / "frames.csv") >= LEAST + 1)
    process.kill()
    process.wait()
    before = (out / "trajectory.tum").read_text()
    done = subprocess.run([*command, str(walk), "--resume"], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    after = (out / "trajectory.tum").read_text()
    assert after.startswith(before.rpartition("\n")[0])
    header, *rows = (out / "frames.csv").read_text().splitlines()
    stamps = [float(row.split(",")[header.split(",").index("t")]) for row in rows]
    assert stamps[-1] == clip.frames[-1].t
    assert sorted(set(stamps)) == stamps
    assert json.loads((out / "summary.json").read_text())["frames"] == lines(out / "frames.csv") - 1


def lines(path: Path) -> int:
    return path.read_text().count("\n") if path.is_file() else 0


@pytest.mark.slow
def test_ctrl_c_ends_with_everything_written(clip: Clip, address: Address, tmp_path: Path) -> None:
    walk, out = write_recording(Held(clip, pause=LONGEST), tmp_path / "walk"), tmp_path / "out"
    command = [sys.executable, "-m", "collabslam", "live", "robot", str(walk), "--insecure"]
    command += ["--listen", f"127.0.0.1:{address.port}", "--out", str(out), "--record", str(tmp_path / "rec")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert until(lambda: lines(out / "frames.csv") >= LEAST)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=LONGEST)
    assert process.returncode == 0
    assert str(out) in said
    summary = json.loads((out / "summary.json").read_text())
    assert summary["interrupted"] is True
    assert summary["frames"] == lines(out / "frames.csv") - 1
    assert replay(tmp_path / "rec", tmp_path / "again")["frames"] == summary["frames"]

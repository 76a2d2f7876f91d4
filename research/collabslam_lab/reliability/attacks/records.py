"""Records of live runs that nobody recorded, made by hand; `collabslam live replay` is given them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from collabslam import Camera
from collabslam.live import messages
from collabslam.live.clock import Exchange
from collabslam.live.record import (
    BIAS,
    CLOCK,
    ODOMETRY,
    OWN,
    PLAN,
    ROBOT_IMAGE,
    ROBOT_INFO,
    T_CF,
    WORN_IMAGE,
    WORN_INFO,
)
from collabslam_lab.reliability.attacks.attack import (
    HELD_OR_TOLD,
    READ_OR_REFUSED,
    REFUSED,
    Attack,
    Deed,
)
from collabslam_lab.reliability.attacks.scene import Scene

CAMERA = Camera("pinhole", 64, 48, (50.0, 50.0, 32.0, 24.0))
GREY = np.zeros((48, 64), np.uint8)
GOOD: dict[str, Any] = {
    "mode": "mono",
    "start": "scale-free",
    "settings": {},
    "tags": [],
    "boards": [],
    "t_bc": None,
    "persons": [],
    "imu": None,
}
Told = tuple[str, str, bytes]
ASKED = messages.exchange("a b", Exchange(1.0, 1.0, 1.0, 1.0))
JPEG = b"\xff\xd8\xff\xe0 and so on"


def plan(**changed: Any) -> Told:
    return PLAN, messages.TEXT, messages.text(json.dumps({**GOOD, **changed}))


def info(topic: str = ROBOT_INFO) -> Told:
    return topic, messages.CAMERA_INFO, messages.camera_info(0.0, "cs", CAMERA)


def image(t: float = 1.0) -> Told:
    return ROBOT_IMAGE, messages.IMAGE, messages.raw_image(t, "cs", GREY)


def worn(frame: str = "anna/1", topic: str = WORN_IMAGE) -> Told:
    return topic, messages.COMPRESSED, messages.compressed_image(1.0, frame, JPEG)


def record(folder: Path, *told: Told) -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer

    path = folder / "record"
    with Writer(path, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP) as bag:
        known: dict[tuple[str, str], Any] = {}
        for k, (topic, kind, data) in enumerate(told):
            if (topic, kind) not in known:
                known[topic, kind] = bag.add_connection(topic, kind, typestore=messages.store())
            bag.write(known[topic, kind], k + 1, data)
    return path


def text(topic: str) -> Told:
    return topic, messages.TEXT, messages.text("x")


def said(value: str) -> Told:
    return PLAN, messages.TEXT, messages.text(value)


BROKEN: dict[str, Callable[[], list[Told]]] = {
    "nothing": lambda: [text("/chatter")],
    "no-plan": lambda: [info(), image()],
    "plan-type": lambda: [(PLAN, messages.POSE, messages.pose(0.0, "x", np.eye(4), np.eye(6))), info()],
    "plan-list": lambda: [said("[]"), info(), image()],
    "plan-null": lambda: [said("null"), info(), image()],
    "plan-word": lambda: [said("hello"), info(), image()],
    "plan-empty": lambda: [said(""), info(), image()],
    "plan-deep": lambda: [said("[" * 100_000), info(), image()],
    "plan-number": lambda: [said('{"mode": ' + "9" * 5000 + "}"), info(), image()],
    "plan-less": lambda: [said('{"mode": "mono"}'), info(), image()],
    "plan-more": lambda: [plan(out="/etc"), info(), image()],
    "mode": lambda: [plan(mode="best"), info(), image()],
    "imu-short": lambda: [plan(imu={"r_ci": [1.0] * 8}), info(), image()],
    "imu-none": lambda: [plan(imu={"mount_sd": 0.1}), info(), image()],
    "mode-list": lambda: [plan(mode=["mono"]), info(), image()],
    "start": lambda: [plan(start="../map"), info(), image()],
    "settings-list": lambda: [plan(settings=[1]), info(), image()],
    "settings-key": lambda: [plan(settings={"filter.magic": 1}), info(), image()],
    "settings-value": lambda: [plan(settings={"filter.lost.after": "soon"}), info(), image()],
    "tag": lambda: [plan(tags=["x"]), info(), image()],
    "tag-number": lambda: [plan(tags=[7]), info(), image()],
    "tag-size": lambda: [plan(tags=["36h11:3=-1"]), info(), image()],
    "board": lambda: [plan(boards=["7x5"]), info(), image()],
    "mount-short": lambda: [plan(t_bc=[1.0]), info(), image()],
    "mount-words": lambda: [plan(t_bc=["x"] * 16), info(), image()],
    "mount-crooked": lambda: [plan(t_bc=[2.0] * 16, start="odometry"), info(), image()],
    "persons-above": lambda: [plan(persons=["../../../pwned"]), info(), info("/../../../pwned" + WORN_INFO)],
    "persons-root": lambda: [plan(persons=["/pwned"]), info(), image()],
    "persons-nul": lambda: [plan(persons=["a\0b"]), info(), image()],
    "persons-line": lambda: [plan(persons=["a\nb"]), info(), image()],
    "persons-twice": lambda: [plan(persons=["anna", "anna"]), info(), info("/anna" + WORN_INFO), image()],
    "persons-text": lambda: [plan(persons="anna"), info(), image()],
    "persons-number": lambda: [plan(persons=[7]), info(), image()],
    "persons-away": lambda: [plan(mode="collab", start="worn", persons=["anna"]), info(), image()],
    "no-camera": lambda: [plan(), image()],
    "camera-type": lambda: [plan(), text(ROBOT_INFO), image()],
    "camera-cut": lambda: [plan(), (ROBOT_INFO, messages.CAMERA_INFO, info()[2][:40]), image()],
    "image-type": lambda: [plan(), info(), text(ROBOT_IMAGE)],
    "image-cut": lambda: [plan(), info(), (ROBOT_IMAGE, messages.IMAGE, image()[2][:60])],
    "image-two-types": lambda: [plan(), info(), image(), text(ROBOT_IMAGE)],
    "worn-type": lambda: [plan(), info(), image(), text(WORN_IMAGE)],
    "worn-session": lambda: [plan(), info(), image(), worn("anna/1\nben")],
    "worn-frame": lambda: [plan(), info(), image(), worn("../../anna")],
    "clock-type": lambda: [plan(), info(), image(), text(CLOCK)],
    "clock-long": lambda: [plan(), info(), image(), (CLOCK, messages.TIMES, messages.times("a", [1.0] * 9))],
    "clock-session": lambda: [plan(), info(), image(), (CLOCK, messages.TIMES, ASKED)],
    "bias-short": lambda: [plan(), info(), image(), (BIAS, messages.NUMBERS, messages.numbers(np.ones(3)))],
    "bias-type": lambda: [plan(), info(), image(), text(BIAS)],
    "pose-type": lambda: [plan(), info(), image(), text(T_CF)],
    "own-type": lambda: [plan(), info(), image(), text(OWN)],
    "odometry-type": lambda: [plan(), info(), image(), text(ODOMETRY)],
}  # fmt: skip


def _asked(count: int) -> list[Told]:
    """Exchanges of so many sessions."""
    reading = Exchange(1.0, 1.0, 1.0, 1.0)
    return [(CLOCK, messages.TIMES, messages.exchange(f"a/{k}", reading)) for k in range(count)]


def _large() -> Told:
    camera = Camera("pinhole", 60_000, 60_000, (6e4, 6e4, 3e4, 3e4))
    return ROBOT_INFO, messages.CAMERA_INFO, messages.camera_info(0.0, "cs", camera)


MANY: dict[str, Callable[[], list[Told]]] = {
    "persons-100000": lambda: [plan(persons=[f"p{k}" for k in range(100_000)]), info(), image()],
    "tags-100000": lambda: [plan(tags=["36h11:3=0.16"] * 100_000), info(), image()],
    "boards-wide": lambda: [plan(boards=["100000x100000:0.1"]), info(), image()],
    "settings-200000": lambda: [plan(settings={f"a{k}": 1 for k in range(200_000)}), info(), image()],
    "settings-huge": lambda: [plan(settings={"filter.map.in_view": 10**300}), info(), image()],
    "plans-20000": lambda: [*([plan()] * 20_000), info(), image()],
    "camera-60000": lambda: [plan(), _large(), image()],
    "images-back": lambda: [plan(), info(), *(image(10.0 - k) for k in range(8))],
    "images-far": lambda: [plan(), info(), *(image(1e9 * k) for k in range(3))],
    "sessions-20000": lambda: [plan(), info(), image(), *(worn(f"p{k}/1") for k in range(20_000))],
    "clocks-20000": lambda: [plan(), info(), image(), *_asked(20_000)],
}  # fmt: skip


def _replayed(name: str) -> Callable[[Scene], Deed]:
    def make(scene: Scene) -> Deed:
        path = record(scene.folder, *{**BROKEN, **MANY}[name]())
        return scene.command("live", "replay", path, "--out", scene.out)

    return make


ATTACKS = tuple(
    Attack("record", name, f"a record made by hand: {name.replace('-', ', ')}", _replayed(name), good)
    for rows, good in ((BROKEN, REFUSED), (MANY, (*READ_OR_REFUSED, *HELD_OR_TOLD)))
    for name in rows
)

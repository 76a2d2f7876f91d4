"""Damaged result folders of live runs: going on with one is refused, and no link in it is followed."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path

from collabslam.live.results import ENGINE
from collabslam_lab.reliability.attacks.attack import REFUSED, Attack, Deed
from collabslam_lab.reliability.attacks.scene import Scene


def appended(name: str, data: bytes) -> Callable[[Path], object]:
    return lambda out: (out / name).write_bytes((out / name).read_bytes() + data)


def holding(name: str, data: bytes) -> Callable[[Path], object]:
    return lambda out: (out / name).write_bytes(data)


def gone(name: str) -> Callable[[Path], None]:
    return lambda out: (out / name).unlink()


def folder(name: str) -> Callable[[Path], None]:
    def make(out: Path) -> None:
        (out / name).unlink()
        (out / name).mkdir()

    return make


def linked(name: str) -> Callable[[Path], None]:
    def make(out: Path) -> None:
        (out / name).rename(out.parent / "mine")
        (out / name).symlink_to(out.parent / "mine")

    return make


DAMAGES: dict[str, Callable[[Path], object]] = {
    "engine-empty": holding(ENGINE, b""),
    "engine-cut": holding(ENGINE, b"CLABBOX\n" + bytes(30)),
    "engine-gone": gone(ENGINE),
    "engine-folder": folder(ENGINE),
    "frames-gone": gone("frames.csv"),
    "frames-bytes": appended("frames.csv", b"\xff\xfe\n"),
    "frames-nul": appended("frames.csv", b"\0\n"),
    "frames-quote": appended("frames.csv", b'"open\n'),
    "frames-short": appended("frames.csv", b"1,2,3\n"),
    "frames-header": holding("frames.csv", b"a,b\n1,2\n"),
    "frames-words": holding("frames.csv", b"index,t\n0,now\n"),
    "frames-nan": holding("frames.csv", b"index,t\n0,nan\n"),
    "frames-line": holding("frames.csv", b"\n"),
    "frames-folder": folder("frames.csv"),
    "frames-linked": linked("frames.csv"),
    "tum-gone": gone("trajectory.tum"),
    "tum-bytes": appended("trajectory.tum", b"\xff\n"),
    "tum-linked": linked("trajectory.tum"),
    "cov-gone": gone("trajectory.cov"),
    "cov-folder": folder("trajectory.cov"),
}


def _gone_on(damage: Callable[[Path], object]) -> Callable[[Scene], Deed]:
    def make(scene: Scene) -> Deed:
        damage(scene.copy("driven"))
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        link = ("--insecure", "--listen", f"127.0.0.1:{port}", "--mode", "mono", "--start", "scale-free")
        return scene.command("live", "robot", scene.ground.short, *link, "--out", scene.out, "--resume")

    return make


ATTACKS = tuple(
    Attack(
        "live folder", name, f"going on with a live run: {name.replace('-', ', ')}", _gone_on(damage), REFUSED
    )
    for name, damage in DAMAGES.items()
)

"""Result folders of somebody else, as `doctor`, `compare` and `export` are given them."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from collabslam_lab.reliability.attacks.attack import HELD_OR_TOLD, READ_OR_REFUSED, Attack, Deed
from collabslam_lab.reliability.attacks.scene import Scene

ANY = (*READ_OR_REFUSED, *HELD_OR_TOLD)
Damage = Callable[[Path], object]


def _summary(**changed: Any) -> Damage:
    def change(run: Path) -> None:
        path = run / "summary.json"
        told = json.loads(path.read_text(encoding="utf-8"))
        path.write_text(json.dumps({**told, **changed}), encoding="utf-8")

    return change


def _holding(name: str, data: bytes) -> Damage:
    return lambda run: (run / name).write_bytes(data)


def _cell(column: str, value: str) -> Damage:
    """A column of frames.csv that says something else in all rows."""

    def change(run: Path) -> None:
        head, *rows = (run / "frames.csv").read_text(encoding="utf-8").splitlines()
        at = head.split(",").index(column)
        changed = [",".join([*row.split(",")[:at], value, *row.split(",")[at + 1 :]]) for row in rows]
        (run / "frames.csv").write_text("\n".join([head, *changed, ""]), encoding="utf-8")

    return change


def _long(run: Path) -> None:
    path = run / "frames.csv"
    head, first, *_ = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text(head + first * 20_000, encoding="utf-8")


def _to(name: str, place: str) -> Damage:
    def change(run: Path) -> None:
        (run / name).unlink()
        (run / name).symlink_to(place)

    return change


def _pipe(name: str) -> Damage:
    def change(run: Path) -> None:
        (run / name).unlink()
        os.mkfifo(run / name)

    return change


TUM = b"0.1 1 2 3 0 0 0 1\n"
PLY = (
    b"ply\nformat ascii 1.0\nelement vertex %s\nproperty float x\nproperty float y\nproperty float z\n"
    b"end_header\n"
)
DAMAGES: dict[str, tuple[str, Damage]] = {
    "summary-list": ("summary.json is a list", _holding("summary.json", b"[]")),
    "summary-deep": ("summary.json is 100 000 deep", _holding("summary.json", b"[" * 100_000)),
    "summary-digits": ("summary.json has a number of 10 000 digits",
                       _holding("summary.json", b'{"frames": ' + b"9" * 10_000 + b"}")),
    "summary-words": ("its shares are words", _summary(ok_share="all", false_ok_share="none", frames="many")),
    "summary-nan": ("its shares are no numbers", _summary(ok_share=float("nan"), ate_pct=float("inf"))),
    "summary-huge": ("it tells 10^300 frames", _summary(frames=10**300, ok_frames=10**300)),
    "summary-lists": ("its values are lists", _summary(frames=[], mode={}, statuses=[1], unit=[["m"]])),
    "summary-null": ("its values are nothing", _summary(frames=None, mode=None, recording=None)),
    "summary-bell": ("its recording is called as a terminal's commands",
                     _summary(recording="\x1b[2J\a\n" * 1000)),
    "frames-huge": ("its first stamp is 1e308", _cell("t", "1e308")),
    "frames-nan": ("its stamps are no numbers", _cell("t", "nan")),
    "frames-words": ("its matches are words", _cell("found", "many")),
    "frames-status": ("a status that there is not", _cell("status", "FINE")),
    "frames-formula": ("its cells are formulas", _cell("degraded_by", "=cmd|' /C calc'!A0")),
    "frames-long": ("20 000 frames of one stamp", _long),
    "frames-empty": ("frames.csv is empty", _holding("frames.csv", b"")),
    "frames-zero": ("frames.csv has zero bytes", _holding("frames.csv", b"\0" * 10_000)),
    "frames-quoted": ("a quotation that never ends",
        _holding("frames.csv", b'index,t\n"' + b"x" * 5_000_000)),
    "tum-nan": ("its trajectory is no numbers", _holding("trajectory.tum", b"0.1 nan nan nan 0 0 0 1\n" * 8)),
    "tum-huge": ("its trajectory is at 1e308",
        _holding("trajectory.tum", b"0.1 1e308 1e308 1e308 0 0 0 1\n" * 8)),
    "tum-turn": ("its attitudes are zero", _holding("trajectory.tum", b"0.1 1 2 3 0 0 0 0\n" * 8)),
    "tum-back": ("its stamps go back", _holding("trajectory.tum", b"0.2 1 2 3 0 0 0 1\n" + TUM)),
    "tum-bytes": ("its trajectory is no text", _holding("trajectory.tum", b"\xff\xfe\0" * 100)),
    "tum-pipe": ("its trajectory is a pipe", _pipe("trajectory.tum")),
    "tum-zero": ("its trajectory is /dev/zero", _to("trajectory.tum", "/dev/zero")),
    "cov-words": ("its covariances are words", _holding("trajectory.cov", b"0.1 a b c\n" * 8)),
    "cov-negative": ("its covariances are negative",
        _holding("trajectory.cov", b"0.1" + b" -1" * 21 + b"\n")),
    "ply-many": ("a map of 2^62 points", _holding("map.ply", PLY.replace(b"%s", b"4611686018427387904"))),
    "ply-nan": ("a map of points that are none",
        _holding("map.ply", PLY.replace(b"%s", b"1") + b"nan nan nan\n")),
    "config-code": ("config.yaml asks for a program",
                    _holding("config.yaml", b"a: !!python/object/apply:os.system [touch pwned]\n")),
    "config-words": ("config.yaml is a word", _holding("config.yaml", b"hello")),
    "truth-huge": ("its true poses are at 1e308",
        _holding("groundtruth.tum", b"0.1 1e308 0 0 0 0 0 1\n" * 8)),
}  # fmt: skip


def _doctor(scene: Scene, run: Path) -> tuple[object, ...]:
    return "doctor", run


def _compare(scene: Scene, run: Path) -> tuple[object, ...]:
    return "compare", scene.ground.finished, run, "--out", scene.out / "picture.png"


def _export(scene: Scene, run: Path) -> tuple[object, ...]:
    return "export", run, scene.out / "model", "--format", "euroc"


def _given(damage: Damage, words: Callable[[Scene, Path], tuple[object, ...]]) -> Callable[[Scene], Deed]:
    def make(scene: Scene) -> Deed:
        run = shutil.copytree(scene.ground.finished, scene.folder / "run")
        damage(run)
        return scene.command(*words(scene, run))

    return make


ATTACKS = tuple(
    Attack("result folder", f"{command}-{name}", f"{command} of a run: {what}", _given(damage, words), ANY)
    for command, words in (("doctor", _doctor), ("compare", _compare), ("export", _export))
    for name, (what, damage) in DAMAGES.items()
)

"""Checkpoints and saved maps that were altered, with the checksum that belongs to what is in them."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.formats import container
from collabslam.runs import checkpoint
from collabslam.runs.results import CHECKPOINT
from collabslam.slam.map import saved_map
from collabslam.slam.saving import CLASSES
from collabslam_lab.reliability.attacks.attack import READ_OR_REFUSED, REFUSED, Attack, AttackOutcome, Deed
from collabslam_lab.reliability.attacks.scene import Scene

VICTIM = "victim.txt"
Damage = Callable[[bytes], bytes]
Alter = Callable[[Any], Any]

RAW: tuple[tuple[str, str, Damage], ...] = (
    ("empty", "empty", lambda data: b""),
    ("cut", "cut off in its middle", lambda data: data[: len(data) // 2]),
    ("flipped", "a bit turned over", lambda data: data[:5000] + bytes([data[5000] ^ 1]) + data[5001:]),
    ("text", "a text", lambda data: b"hello\n" * 100),
    ("pickle", "a pickle that calls the shell", lambda data: pickle.dumps(_Shell())),
    ("version", "of a later container", lambda data: container.seal(data[:8] + b"\xff\0\0\0" + data[12:])),
    ("header", "a header of 2^63 bytes",
     lambda data: container.seal(data[:12] + b"\xff" * 7 + b"\x7f" + data[20:])),
    ("garbage", "random bytes under a good checksum",
     lambda data: container.seal(data[:20] + np.random.default_rng(0).bytes(4096) + bytes(32))),
)  # fmt: skip


class _Shell:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, ("touch stolen",)


def _put(*path: object, value: Any, new: bool = False) -> Alter:
    """One thing in a tree replaced, by a value or what a function makes of the old; or a ``new`` one added.

    What is to be replaced must be there: else an attack on it attacks nothing.
    """

    def alter(tree: Any) -> Any:
        if len(path) == 0:
            return value(tree) if callable(value) else value
        key, rest = path[0], path[1:]
        if isinstance(tree, dict):
            there = None if new and not rest else tree[key]
            return {**tree, key: _put(*rest, value=value, new=new)(there)}
        items = list(tree)
        items[key] = _put(*rest, value=value, new=new)(items[key])  # type: ignore[call-overload]
        return type(tree)(items)

    return alter


def _nan(array: Any) -> Any:
    return np.full_like(array, np.nan)


SMALL = ("pinhole", 10, 10, (9.0, 9.0, 5.0, 5.0), ())
STOPPED: tuple[tuple[str, str, Alter], ...] = (
    ("no-engine", "no engine in it", _put("engine", value={})),
    ("no-filter", "no filter in its engine", _put("engine", "filter", value=b"")),
    ("filter", "a filter with a byte turned over",
     _put("engine", "filter", value=lambda data: data[:200] + b"\xff" + data[201:])),
    ("filter-cut", "half a filter", _put("engine", "filter", value=lambda data: data[: len(data) // 2])),
    ("filter-nan", "a filter of numbers that are none", _put("engine", "filter", value=lambda data: data[:600]
     + np.full((len(data) - 632) // 8, np.nan).tobytes() + data[-(32 + (len(data) - 632) % 8):])),
    ("frames", "a record of poses one short", _put("record", "poses", value=lambda poses: poses[:-1])),
    ("poses", "a record of poses that are none", _put("record", "poses", value=lambda poses: poses * 3.0)),
    ("covariances", "negative covariances", _put("record", "covariances", value=lambda cov: -cov)),
    ("times", "a record whose stamps go back",
     _put("record", "times", value=lambda times: times[::-1].copy())),
    ("status", "a status that there is not", _put("record", "statuses", 0, value="FINE")),
    ("mode", "a mode that there is not", _put("plan", "mode", value="best")),
    ("settings", "a setting that there is not",
     _put("plan", "settings", "values", "filter.x", value=1, new=True)),
    ("setting", "a setting out of bounds",
     _put("plan", "settings", "values", "filter.map.in_view", value=10**12)),
    ("program", "of another version of the program", _put("program", value="99.0")),
    ("source", "of a recording that is a system's file", _put("reopen", "path", value="/etc/passwd")),
    ("device", "of a recording that is a device", _put("reopen", "path", value="/dev/zero")),
    ("no-source", "that does not know its recording", _put("reopen", value=None)),
    ("camera", "of another camera", _put("engine", "camera", value=SMALL)),
    ("camera-nan", "of a camera without a focal length",
     _put("engine", "camera", 3, value=(float("nan"), 620.0, 359.5, 239.5))),
    ("patches", "patches of no feature", _put("engine", "parts", "tracks", "_features", value={})),
    ("pixels", "an image of another size",
     _put("engine", "parts", "blank", "_last", value=np.zeros((2, 2), np.uint8))),
    ("counter", "a counter of 10^300 frames", _put("engine", "parts", "monitor", "_failed", value=10**300)),
    ("part", "a part that there is not", _put("engine", "parts", "_door", value={}, new=True)),
    ("deep", "lists 200 deep", _put("engine", "more", value=lambda _: _deep(200), new=True)),
    ("victim", "that names a file to write to", _put("plan", "save_map", value=VICTIM, new=True)),
)  # fmt: skip

HARMLESS = ("pixels",)
"""What a run can go on with."""

MAPS: tuple[tuple[str, str, Alter], ...] = (
    ("nan", "landmarks that are not numbers", _put("landmarks", value=_nan)),
    ("far", "landmarks at 1e300 m", _put("landmarks", value=lambda a: a + 1e300)),
    ("none", "no landmark at all", _put("landmarks", value=lambda a: a[:0])),
    ("columns", "landmarks of five numbers", _put("landmarks", value=lambda a: a[:, :5].copy())),
    ("behind", "negative inverse depths", _put("landmarks", value=lambda a: a * [1, 1, 1, 1, 1, -1.0])),
    ("negative", "a negative covariance", _put("covariance", value=lambda a: -a)),
    ("crooked", "a covariance that is not symmetric", _put("covariance", value=lambda a: np.triu(a) * 2.0)),
    ("covariance-nan", "a covariance that is none", _put("covariance", value=_nan)),
    ("place", "a place in W of negative covariance", _put("place", value=lambda a: a - np.eye(6))),
    ("owner", "views of landmarks that there are not", _put("owner", value=lambda a: a + 10**6)),
    ("views", "a view too few", _put("pixels", value=lambda a: a[1:].copy())),
    ("poses", "views from nowhere", _put("t_wc", value=_nan)),
    ("places", "views of pixels beyond the image", _put("uv", value=lambda a: a + 1e9)),
    ("camera", "of a camera without a focal length", _put("camera", 3, value=(0.0, 0.0, 0.0, 0.0))),
    ("unit", "in no unit", _put("metric", value="metres")),
)  # fmt: skip


def _deep(levels: int) -> Any:
    tree: Any = 1
    for _ in range(levels):
        tree = [tree]
    return tree


def _resume(scene: Scene, change: Callable[[Path], None]) -> Deed:
    out = scene.copy("stopped")
    (scene.folder / VICTIM).write_text("mine")
    change(out / CHECKPOINT)
    return scene.command("run", "--resume", out)


def _damaged(row: tuple[str, str, Damage]) -> Attack:
    def change(path: Path) -> None:
        path.write_bytes(row[2](path.read_bytes()))

    return Attack("checkpoint", row[0], f"a checkpoint: {row[1]}", lambda scene: _resume(scene, change))


def _altered(row: tuple[str, str, Alter]) -> Attack:
    def change(path: Path) -> None:
        tree = container.read_container(path, checkpoint.KIND, checkpoint.VERSION, CLASSES)
        tree = row[2](tree)
        container.write_container(path, checkpoint.KIND, checkpoint.VERSION, tree, CLASSES)

    good = READ_OR_REFUSED if row[0] in HARMLESS else REFUSED
    what = f"a checkpoint, sealed: {row[1]}"
    return Attack("checkpoint", row[0], what, lambda scene: _resume(scene, change), good)


def _beside(
    name: str, what: str, change: Callable[[Path], object], good: tuple[AttackOutcome, ...]
) -> Attack:
    def make(scene: Scene) -> Deed:
        out = scene.copy("stopped")
        change(out)
        return scene.command("run", "--resume", out)

    return Attack("checkpoint", name, f"the result folder to go on with: {what}", make, good)


def _map(row: tuple[str, str, Damage | Alter], *, sealed: bool) -> Attack:
    def make(scene: Scene) -> Deed:
        path = scene.copy("map")
        if sealed:
            kind, version, classes = saved_map.KIND, saved_map.VERSION, saved_map.CLASSES
            tree = row[2](container.read_container(path, kind, version, classes))
            container.write_container(path, kind, version, tree, classes)
        else:
            path.write_bytes(row[2](path.read_bytes()))
        return scene.run("--map", path, "--mode", "mono")

    return Attack("map", row[0], f"a map{', sealed' if sealed else ''}: {row[1]}", make, REFUSED, "saved.map")


def _append(path: Path, text: str) -> None:
    path.write_text(path.read_text(encoding="utf-8") + text, encoding="utf-8")


def _to_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _to_device(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def _swapped(scene: Scene) -> Deed:
    return scene.run("--map", scene.copy("stopped") / CHECKPOINT, "--mode", "mono", "--overwrite")


ATTACKS = (
    *(_damaged(row) for row in RAW),
    *(_altered(row) for row in STOPPED),
    _beside("pipe", "its checkpoint is a pipe", lambda out: _to_pipe(out / CHECKPOINT), REFUSED),
    _beside("zero", "its checkpoint is a link to /dev/zero", lambda out: _to_device(out / CHECKPOINT),
            REFUSED),
    _beside("no-rows", "frames.csv is gone", lambda out: (out / "frames.csv").unlink(), READ_OR_REFUSED),
    _beside("few-rows", "frames.csv is shorter than the checkpoint says",
            lambda out: os.truncate(out / "frames.csv", 200), READ_OR_REFUSED),
    _beside("torn", "half a line at the end of a trajectory",
            lambda out: _append(out / "trajectory.tum", "0.5 1.0 2."), READ_OR_REFUSED),
    _beside("no-settings", "config.yaml is gone", lambda out: (out / "config.yaml").unlink(),
            READ_OR_REFUSED),
    *(_map(row, sealed=False) for row in RAW),
    *(_map(row, sealed=True) for row in MAPS),
    Attack("map", "checkpoint", "a checkpoint given as a map", _swapped, REFUSED, CHECKPOINT),
)  # fmt: skip

"""Command lines that make no sense."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from collabslam_lab.reliability.attacks.attack import HELD, REFUSED, Attack, Deed
from collabslam_lab.reliability.attacks.scene import Scene

RUN: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("mode", "a mode that there is not", ("--mode", "best")),
    ("no-frames", "at most 0 frames", ("--max-frames", "0")),
    ("negative-frames", "at most -3 frames", ("--max-frames", "-3")),
    ("word-frames", "at most many frames", ("--max-frames", "many")),
    ("lag-nan", "a worn camera that lags by nan", ("--worn", "lag:nan")),
    ("worn", "a worn camera of an unknown kind", ("--worn", "drone")),
    ("views", "views in a folder that there is not", ("--worn", "views:/nowhere")),
    ("rig", "a rig that the recording has not", ("--worn", "rig")),
    ("share", "Cf there for twice the time", ("--worn", "lag:0.2", "--worn-available", "2")),
    ("share-nan", "Cf there for nan of the time", ("--worn", "lag:0.2", "--worn-available", "nan")),
    ("period", "a period of 0 s", ("--worn", "lag:0.2", "--worn-period", "0")),
    ("intervals", "an interval that ends before it begins", ("--worn", "lag:0.2", "--worn-intervals", "5-2")),
    ("noise", "two numbers of noise for four", ("--worn", "lag:0.2", "--worn-noise", "1,2")),
    ("noise-nan", "noise that is not a number", ("--worn", "lag:0.2", "--worn-noise", "nan,1,1,1")),
    ("noise-minus", "negative noise", ("--worn", "lag:0.2", "--worn-noise", "-1,1,1,1")),
    ("seed", "seed -1", ("--worn", "lag:0.2", "--seed", "-1")),
    ("checkpoint", "a checkpoint every 0 frames", ("--checkpoint-every", "0")),
    ("checkpoint-nan", "a checkpoint every nan seconds", ("--checkpoint-every", "nans")),
    ("target", "a start from a target that is not there", ("--start", "target")),
    ("map-gone", "a map that there is not", ("--map", "/nowhere.map", "--mode", "mono")),
    ("camera-gone", "a calibration that there is not", ("--camera", "/nowhere.yaml")),
    ("poses-gone", "true poses that there are not", ("--poses", "/nowhere.tum")),
    ("times-gone", "stamps that there are not", ("--times", "/nowhere.txt")),
    ("option", "an option that there is not", ("--faster",)),
)


def _file(scene: Scene, name: str, content: bytes) -> Path:
    path = scene.folder / name
    path.write_bytes(content)
    return path


def _empty(scene: Scene) -> Path:
    path = scene.folder / "empty"
    path.mkdir()
    return path


def _phone(scene: Scene) -> Path:
    return _file(scene, "phone.mp4", b"\0\0\0\x18ftypmp42" + bytes(4000))


def _pictures(scene: Scene) -> Path:
    path = scene.folder / "pictures"
    (scene.copy("short") / "cam0" / "data").rename(path)
    return path


OTHERS: tuple[tuple[str, str, Callable[[Scene], tuple[object, ...]], str], ...] = (
    ("command", "a command that there is not", lambda scene: ("fly",), "fly"),
    ("no-source", "run of nothing", lambda scene: ("run",), "SOURCE"),
    ("source", "run of a folder that there is not", lambda scene: ("run", "/nowhere"), "/nowhere"),
    ("empty", "run of an empty folder", lambda scene: ("run", _empty(scene)), "empty"),
    ("root", "run of the root folder", lambda scene: ("run", "/"), ""),
    ("zero", "run of /dev/zero", lambda scene: ("run", "/dev/zero"), ""),
    ("text", "run of a text file", lambda scene: ("run", _file(scene, "a.txt", b"hello")), "a.txt"),
    ("letters", "run of a name of 5000 letters", lambda scene: ("run", "a" * 5000), ""),
    ("bytes", "run of a name that is not UTF-8", lambda scene: ("run", "\udcff\udcfe"), ""),
    ("lines", "run of a name with line feeds", lambda scene: ("run", "a\nb"), ""),
    ("video", "a phone's video without a calibration",
     lambda scene: ("run", _phone(scene)), "collabslam init"),
    ("video-bad", "a video that is none, with a calibration", lambda scene: (
        "run", _phone(scene), "--camera",
        scene.ground.short / "cam0" / "sensor.yaml"), "phone.mp4"),
    ("pictures", "a folder of pictures without a calibration",
     lambda scene: ("run", _pictures(scene)), "collabslam init"),
    ("resume-empty", "going on with an empty folder", lambda scene: ("run", "--resume", _empty(scene)),
     "empty"),
    ("resume-more", "going on with other options",
     lambda scene: ("run", "--resume", scene.copy("stopped"), "--mode", "mono"), "--mode"),
    ("map-start", "a map and another start", lambda scene: (
        "run", scene.ground.short, "--map", scene.ground.map, "--start", "worn"), "start"),
    ("doctor", "doctor of a folder without a run", lambda scene: ("doctor", _empty(scene)), "empty"),
    ("info", "info of a folder without a recording", lambda scene: ("info", _empty(scene)), "empty"),
    ("check", "check-calib of a folder without a recording",
     lambda scene: ("check-calib", _empty(scene)), "empty"),
    ("export-format", "export to a format that there is not",
     lambda scene: ("export", scene.ground.finished, scene.folder / "a.csv", "--format", "word"), "word"),
    ("export-over", "export over a file", lambda scene: (
        "export", scene.ground.finished, _file(scene, "mine.csv", b"mine"), "--format", "euroc"), "mine.csv"),
    ("export-empty", "export of a folder without a run",
     lambda scene: ("export", _empty(scene), scene.folder / "a.csv", "--format", "euroc"), "empty"),
    ("settings", "a check of settings that there are not",
     lambda scene: ("settings", "check", "/nowhere"), "/nowhere"),
    ("demo-seed", "a demo of seed -1", lambda scene: ("demo", "--seed", "-1", "--out", scene.out), ""),
    ("demo-seeds", "a demo of seeds 5 to 2",
     lambda scene: ("demo", "--seeds", "5-2", "--out", scene.out), ""),
    ("board", "a board that looks the same upside down", lambda scene: (
        "calibrate-person", scene.ground.short, "--board", "8x6", "--square", "0.03"), "board"),
    ("square", "a board of squares of -1 m", lambda scene: (
        "calibrate-person", scene.ground.short, "--board", "9x6", "--square", "-1"), ""),
)  # fmt: skip


def _run(name: str, what: str, words: tuple[str, ...]) -> Attack:
    return Attack("command", name, f"run with {what}", lambda scene: scene.run(*words), REFUSED)


def _other(row: tuple[str, str, Callable[[Scene], tuple[object, ...]], str]) -> Attack:
    name, what, words, says = row

    def make(scene: Scene) -> Deed:
        return scene.command(*words(scene))

    return Attack("command", name, what, make, REFUSED, says)


def _alone(scene: Scene) -> Deed:
    return scene.command()


ATTACKS = (
    *(_run(*row) for row in RUN),
    Attack("command", "nothing", "no command at all: all are listed", _alone, HELD),
    *(_other(row) for row in OTHERS),
)

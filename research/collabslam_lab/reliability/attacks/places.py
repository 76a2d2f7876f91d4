"""Places where results cannot go or must not, streams that nobody reads, limits, and signals."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from collabslam_lab.reliability.attacks.attack import (
    HELD,
    READ_OR_REFUSED,
    REFUSED,
    Attack,
    AttackOutcome,
    Deed,
)
from collabslam_lab.reliability.attacks.scene import PRODUCT, Scene

ENDED = (AttackOutcome.ENDED,)
FINE_OR_ENDED = (AttackOutcome.ENDED, AttackOutcome.HELD)
TWICE = "collabslam_lab.reliability.attacks.twice"


def _file(scene: Scene, name: str = "mine.txt") -> Path:
    path = scene.folder / name
    path.write_text("mine")
    return path


def _into(
    name: str, what: str, place: Callable[[Scene], Path], good: tuple[AttackOutcome, ...] = REFUSED
) -> Attack:
    def make(scene: Scene) -> Deed:
        return scene.command("run", scene.ground.short, "--out", place(scene))

    return Attack("place", name, f"results into {what}", make, good)


def _map_into(
    name: str, what: str, place: Callable[[Scene], Path], good: tuple[AttackOutcome, ...] = REFUSED
) -> Attack:
    return Attack(
        "place", f"map-{name}", f"the map into {what}", lambda s: s.run("--save-map", place(s)), good
    )


def _folder(scene: Scene) -> Path:
    path = scene.folder / "folder"
    path.mkdir()
    (path / "thesis.tex").write_text("mine")
    return path


def _pipe(scene: Scene) -> Path:
    os.mkfifo(scene.folder / "pipe")
    return scene.folder / "pipe"


def _dangling(scene: Scene) -> Path:
    (scene.folder / "link").symlink_to(scene.folder / "nothing" / "below")
    return scene.folder / "link"


def _latest(scene: Scene) -> Path:
    (scene.folder / "latest").mkdir()
    (scene.folder / "latest" / "thesis.tex").write_text("mine")
    return scene.out


def _earlier(scene: Scene) -> Path:
    scene.copy("finished").rename(scene.folder / "run")
    return scene.folder / "run"


def _itself(scene: Scene) -> Path:
    return scene.copy("short")


def _record(*places: str) -> Callable[[Scene], Deed]:
    """A recording written over, into or above itself."""

    def make(scene: Scene) -> Deed:
        walk = scene.copy("short")
        (scene.folder / "recording.yaml").write_text("format: collabslam-recording\nversion: 1\n")
        return scene.command("record", walk, Path(walk, *places), "--overwrite")

    return make


def _run_with(**options: Any) -> Callable[[Scene], Deed]:
    return lambda scene: scene.run(**options)


def _limited(option: str, value: int) -> Callable[[Scene], Deed]:
    return lambda scene: scene.run("--save-map", scene.out / "a.map", limits={option: value})


def _together(scene: Scene) -> Deed:
    """Two runs into one folder at the same time."""
    words = [sys.executable, "-m", PRODUCT, "run", str(scene.ground.walk), "--out", str(scene.out)]
    return Deed([TWICE, str(scene.out), *words])


def _signalled(name: str, what: str, *signals: tuple[signal.Signals, float | str],
               good: tuple[AttackOutcome, ...] = ENDED) -> Attack:  # fmt: skip
    def make(scene: Scene) -> Deed:
        return scene.run("--checkpoint-every", "2", source=scene.ground.walk, signals=list(signals))

    return Attack("signal", name, what, make, good)


def _record_signalled(scene: Scene) -> Deed:
    words = ("record", scene.ground.walk, scene.out)
    return scene.command(*words, signals=[(signal.SIGTERM, 1.5)])


def _check_signalled(scene: Scene) -> Deed:
    return scene.command("check-calib", scene.ground.walk, signals=[(signal.SIGINT, 1.5)])


INT, TERM, KILL, HUP = signal.SIGINT, signal.SIGTERM, signal.SIGKILL, signal.SIGHUP
ATTACKS = (
    _into("file", "a file", _file),
    _into("below-file", "a folder below a file", lambda scene: _file(scene) / "below"),
    _into("system", "/proc", lambda scene: Path("/proc/results")),
    _into("foreign", "a folder of other things", _folder),
    _into("recording", "the recording", _itself),
    _into("dangling", "a link to nothing", _dangling, READ_OR_REFUSED),
    _into("latest", "a folder beside which 'latest' is a folder of one's own", _latest, HELD),
    _into("earlier", "a folder of earlier results", _earlier, HELD),
    _into("long", "a name of 5000 letters", lambda scene: scene.folder / ("a" * 5000)),
    _into("pipe", "a pipe", _pipe),
    _map_into("folder", "a folder", _folder),
    _map_into("below-file", "a place below a file", lambda scene: _file(scene) / "a.map"),
    _map_into("system", "/proc", lambda scene: Path("/proc/a.map")),
    _map_into("pipe", "a pipe", _pipe),
    _map_into("nowhere", "a folder that there is not", lambda scene: scene.folder / "no" / "a.map",
            READ_OR_REFUSED),
    Attack("place", "record-itself", "a recording written over itself", _record()),
    Attack("place", "record-above", "a recording written over the folder it is in", _record("..")),
    Attack("place", "record-inside", "a recording written into itself", _record("copy"), READ_OR_REFUSED),
    Attack("place", "export-pipe", "an export into a pipe", lambda scene: scene.command(
        "export", scene.ground.finished, _pipe(scene), "--format", "euroc")),
    Attack("place", "rerun", "a Rerun recording into /proc",
            lambda scene: scene.run("--save", "/proc/a.rrd")),
    Attack("place", "together", "two runs into one folder at the same time", _together, HELD),
    Attack("limit", "small-files", "a disk that takes no file above 16 KB", _limited("f", 32)),
    Attack("limit", "tiny-files", "a disk that takes no file above 512 bytes", _limited("f", 1)),
    Attack("limit", "few-files", "at most 24 open files", _limited("n", 24), READ_OR_REFUSED),
    Attack("limit", "no-reader", "standard output that nobody reads", _run_with(stdout="closed"), HELD),
    Attack("limit", "no-listener", "standard error that nobody reads", _run_with(stderr="closed"), HELD),
    Attack("limit", "full-output", "standard output on a full device", _run_with(stdout="full"),
            READ_OR_REFUSED),
    Attack("limit", "full-errors", "standard error on a full device", _run_with(stderr="full"), HELD),
    Attack("limit", "no-home", "neither home nor temporary folder",
           _run_with(environment={"HOME": "/nowhere", "TMPDIR": "/nowhere"}), HELD),
    Attack("limit", "ascii", "a terminal of ASCII alone",
           _run_with(environment={"LC_ALL": "C", "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}), HELD),
    _signalled("term", "SIGTERM in the middle", (TERM, "frames")),
    _signalled("int", "Ctrl-C in the middle", (INT, "frames")),
    _signalled("int-twice", "Ctrl-C twice, at once", (INT, "frames"), (INT, "frames")),
    _signalled("int-term", "Ctrl-C and SIGTERM", (INT, "frames"), (TERM, "frames")),
    _signalled("kill", "SIGKILL in the middle", (KILL, "frames")),
    _signalled("hang-up", "the terminal goes away", (HUP, "frames")),
    _signalled("pipe", "SIGPIPE in the middle", (signal.SIGPIPE, "frames"), good=FINE_OR_ENDED),
    _signalled("birth-int", "Ctrl-C while it starts up", (INT, 0.4), good=FINE_OR_ENDED),
    _signalled("birth-term", "SIGTERM while it starts up", (TERM, 0.4), good=FINE_OR_ENDED),
    Attack("signal", "record", "SIGTERM while a recording is written", _record_signalled, FINE_OR_ENDED),
    Attack("signal", "check", "Ctrl-C while a calibration is checked", _check_signalled,
           (*FINE_OR_ENDED, AttackOutcome.TOLD)),
)  # fmt: skip

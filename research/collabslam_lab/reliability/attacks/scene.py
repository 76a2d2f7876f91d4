"""What attacks are made on: a recording, a run, a stopped run, a map and a bag, made once and copied."""

from __future__ import annotations

import hashlib
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from collabslam.datasets import FirstFrames, open_recording, write_recording
from collabslam.datasets.ros.writer import write_bag
from collabslam.datasets.source import Source
from collabslam.formats.trajectory import ARBITRARY
from collabslam.live.core import LiveCore, RobotFrame
from collabslam.live.results import LiveResults
from collabslam.runs.plan import Output
from collabslam.runs.runner import run
from collabslam.settings.table import Settings
from collabslam.simulation import corridor_recording
from collabslam.slam.engine import Slam
from collabslam.types import Recording
from collabslam_lab.reliability.attacks.attack import Deed

SHORT, STOPPED_AT = 8, 4
"""Frames of the short recording, and the one after which its run was stopped."""
PRODUCT = "collabslam"
CHILD = "collabslam_lab.reliability.attacks.child"
_LARGE = 1 << 24


class Ground:
    """The good files, in a folder of their own.

    Attributes
    ----------
    walk : Path
        The demo's corridor, both cameras with noise.
    short : Path
        Its first frames.
    finished, stopped : Path
        Result folders of the short one; the second has a checkpoint.
    driven : Path
        Result folder of a live run of Cs alone.
    map, bag : Path
    """

    def __init__(self, folder: Path, length_m: float = 15.0) -> None:
        recording = corridor_recording(0, length_m=length_m)
        self.walk = write_recording(recording, folder / "walk")
        self.short = write_recording(FirstFrames(recording, SHORT), folder / "short")
        self.finished, self.stopped, self.map = folder / "finished", folder / "stopped", folder / "saved.map"
        opened = open_recording(self.short)
        run(opened, out=Output(self.finished, save_map=self.map))
        run(opened, out=Output(self.stopped, reopen=Source(self.short)), watch=_stop)
        self.bag = folder / "bag"
        write_bag(opened, self.bag, storage="mcap")
        self.driven = folder / "driven"
        _drive(opened, self.driven)


def _drive(recording: Recording, out: Path) -> None:
    """What a live run of Cs alone leaves."""
    out.mkdir()
    settings = Settings.default()
    slam = Slam(recording.camera, mode="mono", start="scale-free", settings=settings)
    core, results = LiveCore(slam), LiveResults(out, settings, ARBITRARY)
    for i in range(len(recording)):
        frame = recording.frame(i)
        pose = core.handle(RobotFrame(frame.t, frame.image))
        if pose is not None:
            results.frame(pose)
    results.finish(slam, {})
    results.close()


def _stop(frame: Any, *_: object) -> None:
    if frame.index == STOPPED_AT:
        raise KeyboardInterrupt


@dataclass(frozen=True)
class Scene:
    """The folder of one attack.

    Attributes
    ----------
    folder : Path
        New and empty; whatever is in it when the attack begins must be there unchanged at its end, but for
        ``out``.
    ground : Ground
    """

    folder: Path
    ground: Ground

    @property
    def out(self) -> Path:
        """Where results go."""
        return self.folder / "out"

    def copy(self, name: str) -> Path:
        """A copy of something of the ground that may be damaged."""
        source: Path = getattr(self.ground, name)
        target = self.out if name in {"stopped", "finished", "driven"} else self.folder / source.name
        if source.is_dir():
            shutil.copytree(source, target)
        else:
            shutil.copyfile(source, target)
        return target

    def run(self, *words: object, source: Path | None = None, **options: Any) -> Deed:
        """``collabslam run`` of a recording, the short one if left out, into `out`."""
        return self.command("run", source or self.ground.short, "--out", self.out, *words, **options)

    def command(self, *words: object, **options: Any) -> Deed:
        """Any command of ``collabslam``."""
        return Deed([PRODUCT, *map(str, words)], **options)

    def child(self, kind: str, name: str) -> Deed:
        """A call or a stream, in a process of its own."""
        return Deed([CHILD, kind, name, str(self.ground.walk), str(self.out)])

    def protected(self) -> dict[str, str]:
        """Everything in the folder but `out`, and what it holds."""
        return {
            str(path.relative_to(self.folder)): _mark(path)
            for path in sorted(self.folder.rglob("*"))
            if self.out not in (path, *path.parents)
        }


def _mark(path: Path) -> str:
    if path.is_symlink():
        return f"link to {path.readlink()}"
    if not path.is_file():
        return "folder" if path.is_dir() else "no regular file"
    if path.stat().st_size > _LARGE:
        return f"{path.stat().st_size} bytes of {path.stat().st_mtime_ns}"
    return hashlib.sha256(path.read_bytes()).hexdigest()


def program(words: list[str], limits: dict[str, int]) -> list[str]:
    """The command of a deed, under the limits of the shell's ``ulimit``."""
    command = [sys.executable, "-m", *words]
    if not limits:
        return command
    asked = " && ".join(f"ulimit -{option} {value}" for option, value in sorted(limits.items()))
    return ["sh", "-c", f'{asked} && exec "$@"', "sh", *command]

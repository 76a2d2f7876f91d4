"""Recordings and worlds run once each, with what the tracker makes of them kept in files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from collabslam.batch.engines import Engine
from collabslam.batch.processes import use_one_thread
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import DataError
from collabslam.runs.runner import run
from collabslam.settings.table import Settings
from collabslam.types import Frame, Recording
from collabslam_lab.appearance.tracking import Tracking
from collabslam_lab.benchmark.plan import Entry, find_plan
from collabslam_lab.benchmark.replay import open_entry
from collabslam_lab.benchmark.store import Item
from collabslam_lab.kept import Task, kept
from collabslam_lab.worlds import Recipe, WorldRecording

FRAMES = 60
"""Of a world, from its beginning; recordings are taken whole."""
QUICK_FRAMES = 20

Numbers = dict[str, float | None]


@dataclass(frozen=True)
class Subject:
    """What is run: a recording, or a world.

    Attributes
    ----------
    name : str
    item : Item or None
        Of the recording.
    recipe : Recipe or None
        Of the world.
    frames : int or None
        How many of them; all if None.
    """

    name: str
    item: Item | None = None
    recipe: Recipe | None = None
    frames: int | None = None

    @property
    def stem(self) -> str:
        """Begins the name of its file."""
        return self.name


def recordings(data: Path, *, quick: bool) -> list[Subject]:
    """Those of the plan of `collabslam-lab evaluate` that a folder holds, each once.

    Raises
    ------
    DataError
        If it holds none.
    """
    found = [
        Subject(
            entry.name, item=Item(entry, _mode(entry), 0, data, data), frames=QUICK_FRAMES if quick else None
        )
        for entry in find_plan(data, None).recordings
        if entry.rendered is None and entry.start != "scale-free" and (data / entry.folder).is_dir()
    ]
    if not found:
        raise DataError(
            f"{data} holds none of the recordings that `collabslam-lab evaluate` knows; "
            "name its folders so, or write an evaluate.yaml there."
        )
    return found


def measure(
    subjects: Sequence[Subject], folder: Path, *, jobs: int, engine: Engine, progress: bool
) -> list[Numbers]:
    """`Tracking.statistics` of each; what `folder` holds is not run again."""
    task = Task(_tracked, _numbers, lambda subject, _: subject.name, "tracking", "run")
    return kept(task, subjects, folder, jobs=jobs, engine=engine, progress=progress)


def _tracked(subject: Subject) -> str:
    return json.dumps(track(subject))


def _numbers(_: Subject, content: Any) -> Numbers:
    if not isinstance(content, dict):
        raise ValueError
    return content


def track(subject: Subject) -> Numbers:
    """One run in one mode, the filter's own default where the recording allows it; also a child's work."""
    use_one_thread()
    watch = Tracking()
    if subject.item is not None:
        item, entry = subject.item, subject.item.entry
        recording = _first(open_entry(item), subject.frames)
        run(recording, mode=item.used_mode, start=entry.start, settings=item.settings, watch=watch)
    elif subject.recipe is not None:
        run(_first(WorldRecording(subject.recipe), subject.frames), start="worn", watch=watch)
    return watch.statistics()


def _mode(entry: Entry) -> str:
    usual = str(Settings.default()["filter.estimator.mode"])
    return usual if usual in entry.modes else entry.modes[0]


def _first(recording: Recording, count: int | None) -> Recording:
    return recording if count is None or count >= len(recording) else FirstFrames(recording, count)


class FirstFrames(WrappedRecording):
    """The first frames of a recording."""

    def __init__(self, base: Recording, count: int) -> None:
        super().__init__(base)
        self.times = base.times[:count]
        self.truth = None if base.truth is None else base.truth[:count]

    def __len__(self) -> int:
        return len(self.times)

    def frame(self, i: int) -> Frame:
        """Frame ``i``."""
        return self._base.frame(i)

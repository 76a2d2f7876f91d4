"""Recordings and worlds run once each, with what the tracker makes of them kept in files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path

from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import DataError
from collabslam.formats.files import write_text
from collabslam.runs.progress import Progress
from collabslam.runs.runner import run
from collabslam.settings.table import Settings
from collabslam.types import Frame, Recording
from collabslam.version import version
from collabslam_lab.benchmark.plan import Entry, find_plan
from collabslam_lab.benchmark.replay import open_entry
from collabslam_lab.benchmark.store import Item
from collabslam_lab.engines import Engine
from collabslam_lab.likeness.tracking import Tracking
from collabslam_lab.processes import use_one_thread
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

    def key(self) -> str:
        """Changes with everything that the result depends on, but for the recording's own files."""
        text = f"{self!r} {version()} {Settings.default().hash()}"
        return hashlib.sha256(text.encode()).hexdigest()[:16]


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
    done = [_read(_path(folder, subject)) for subject in subjects]
    waiting = [k for k, numbers in enumerate(done) if numbers is None]
    with Progress(len(waiting), "tracking", enabled=progress and bool(waiting), unit="run") as bar:
        for k, numbers in _measured({k: subjects[k] for k in waiting}, jobs, engine):
            write_text(_path(folder, subjects[k]), json.dumps(numbers))
            done[k] = numbers
            bar.update(subjects[k].name)
    return [numbers for numbers in done if numbers is not None]


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


def _measured(subjects: Mapping[int, Subject], jobs: int, engine: Engine) -> Iterator[tuple[int, Numbers]]:
    if jobs == 1 and engine.is_local:
        for k, subject in subjects.items():
            yield k, track(subject)
        return
    with engine.pool(jobs) as pool:
        futures = {pool.submit(track, subject): k for k, subject in subjects.items()}
        for future in as_completed(futures):
            yield futures[future], future.result()


def _path(folder: Path, subject: Subject) -> Path:
    return folder / f"{subject.name}-{subject.key()}.json"


def _read(path: Path) -> Numbers | None:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None

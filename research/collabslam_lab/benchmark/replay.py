"""One item run: its recording with its worn camera, the filter, the folder of its results.

A run writes into a folder beside its place, which takes that place when it is done: processes that were given
up and still go on disturb nothing.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import time
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.batch.processes import use_one_thread
from collabslam.datasets import attach_worn
from collabslam.datasets.emulated.views import PosedViews
from collabslam.datasets.ordered import in_order
from collabslam.datasets.readers import collab
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import CollabslamError
from collabslam.runs.plan import Output
from collabslam.runs.results import write_summary
from collabslam.runs.runner import run
from collabslam.simulation.held import HeldRecording
from collabslam.simulation.recording import demo_recording
from collabslam.types import Recording
from collabslam_lab.benchmark.opening import open_folder, worn_of
from collabslam_lab.benchmark.store import KEY, Item, Row


def open_entry(item: Item) -> Recording:
    """The recording of an item, with its worn camera.

    Raises
    ------
    CollabslamError
        If it cannot be opened, or lacks what the worn camera needs.
    """
    entry = item.entry
    folder = item.data / entry.folder
    if entry.draws:
        recording: Recording = in_order(collab.open(folder, folder / entry.draws[item.seed] / "data.csv"))
    else:
        recording = _rendered(item.seed) if entry.rendered else open_folder(entry, item.data)
    if entry.calibration_sd is not None:
        recording = Miscalibrated(recording, entry.calibration_sd, item.seed)
    if entry.worn is not None:
        recording = _with_worn(recording, worn_of(entry, recording), item)
    return recording if entry.scored else Unscored(recording)


def _with_worn(recording: Recording, worn: str | PosedViews, item: Item) -> Recording:
    entry = item.entry
    return attach_worn(
        recording,
        worn,
        available=entry.available,
        period=entry.period,
        noise=entry.noise,
        seed=item.seed,
        bias_per_block=item.bias_per_block,
    )


class Unscored(WrappedRecording):
    """A recording whose truth has served its worn camera and judges nothing: it is too far off itself."""

    def __init__(self, base: Recording) -> None:
        super().__init__(base)
        self.truth = None


class Miscalibrated(WrappedRecording):
    """A recording whose calibration of Cs is wrong on purpose; see `Entry.calibration_sd`."""

    def __init__(self, base: Recording, deviations: tuple[float, ...], seed: int) -> None:
        super().__init__(base)
        camera = base.camera
        focal, u, v, bend = np.random.default_rng([seed, 1]).standard_normal(4) * [
            deviations[0], deviations[1], deviations[1], deviations[2]
        ]  # fmt: skip
        fx, fy, cx, cy = camera.intrinsics
        intrinsics = (fx * (1.0 + focal), fy * (1.0 + focal), cx + u, cy + v)
        distortion = [*camera.distortion]
        if distortion:
            distortion[0] += bend
        self.camera = Camera(camera.model, camera.width, camera.height, intrinsics, distortion)


@lru_cache(maxsize=1)
def _rendered(seed: int) -> Recording:
    return HeldRecording(demo_recording(seed))


def run_item(item: Item) -> Row:
    """Run one item and keep its summary; an error becomes a row."""
    place = None if item.folder is None else _beside(item.folder)
    try:
        notes = {
            KEY: item.fingerprint(),
            "worn": item.entry.worn,
            "worn_available": item.entry.available,
            "seed": item.seed,
            "worn_bias_per_block": item.bias_per_block,
        }
        summary = run(
            open_entry(item),
            mode=item.used_mode,
            start=item.entry.start,
            settings=item.settings,
            out=Output(place, overwrite=True, latest=False, notes=notes),
        ).summary
        if item.folder is None:
            write_summary(item.summary, summary)
    except CollabslamError as error:
        return item.failed(str(error))
    except Exception as error:  # a fault of ours: said, and the others go on
        return item.failed(f"{type(error).__name__}: {error}")
    finally:
        if place is not None and item.folder is not None and place.exists():
            _publish(place, item.folder)
    return item.finished(summary)


def timed_item(item: Item) -> Row:
    """Run one item as a child process does: its row, with the seconds it took."""
    use_one_thread()
    began = time.monotonic()
    row = run_item(item)
    return {**row, "seconds": time.monotonic() - began}


def _beside(folder: Path, who: str | None = None) -> Path:
    return folder.with_name(f".{folder.name}.{who or f'{socket.gethostname()}-{os.getpid()}'}.part")


def _publish(place: Path, folder: Path) -> None:
    """Puts a finished folder in its place; if another process did that just now, theirs is as good."""
    before = place.with_suffix(".old")
    with contextlib.suppress(FileNotFoundError):
        os.rename(folder, before)
    with contextlib.suppress(OSError):
        os.rename(place, folder)
    for rest in (before, place):
        shutil.rmtree(rest, ignore_errors=True)


def clear_beside(items: Sequence[Item]) -> None:
    """Removes what processes that were ended have left beside the items' folders."""
    for folder in {item.folder for item in items if item.folder is not None}:
        for part in folder.parent.glob(_beside(folder, "*").name):
            shutil.rmtree(part, ignore_errors=True)

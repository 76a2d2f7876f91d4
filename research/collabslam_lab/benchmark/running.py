"""Runs items side by side, each group of them in a process of its own, and goes on where one fails."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets import attach_worn, open_recording
from collabslam.datasets.ordered import in_order
from collabslam.datasets.readers import collab
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.demo.demo_run import HeldRecording
from collabslam.demo.recording import corridor_recording
from collabslam.errors import CollabslamError, SettingsError
from collabslam.runs.plan import Output
from collabslam.runs.report import number
from collabslam.runs.results import write_summary
from collabslam.runs.runner import run
from collabslam.types import Recording
from collabslam_lab.benchmark.store import KEY, Item, Row
from collabslam_lab.processes import spawning, use_one_thread

_SECONDS_A_RUN, _SECONDS_A_FRAME, _RENDERED_FRAMES = 1.5, 0.04, 100  # for the estimate of the cost

Told = Callable[[Item, Row], None]


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
        recording = _rendered(item.seed) if entry.rendered else open_recording(folder)
    if entry.calibration_sd is not None:
        recording = Miscalibrated(recording, entry.calibration_sd, item.seed)
    if entry.worn is not None:
        recording = _with_worn(recording, entry.worn, item)
    return recording if entry.scored else Unscored(recording)


def _with_worn(recording: Recording, worn: str, item: Item) -> Recording:
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
    return HeldRecording(corridor_recording(seed), progress=False)


def run_item(item: Item) -> Row:
    """Run one item and keep its summary; an error becomes a row."""
    try:
        notes = {KEY: item.fingerprint(), "worn": item.entry.worn, "worn_available": item.entry.available}
        summary = run(
            open_entry(item),
            mode=item.used_mode,
            start=item.entry.start,
            settings=item.settings,
            out=Output(item.folder, overwrite=True, latest=False),
            notes={**notes, "seed": item.seed, "worn_bias_per_block": item.bias_per_block},
        ).summary
        if item.folder is None:
            write_summary(item.summary, summary)
    except CollabslamError as error:
        return item.failed(str(error))
    except Exception as error:  # a fault of ours: said, and the others go on
        return item.failed(f"{type(error).__name__}: {error}")
    return item.finished(summary)


def run_items(items: Sequence[Item], *, jobs: int, told: Told, again: bool = False) -> list[Row]:
    """Run what is not done yet.

    Parameters
    ----------
    items : sequence of Item
    jobs : int
        Processes at a time, each with one thread.
    told : callable
        Is given each item and its row as it comes in, those done earlier first.
    again : bool
        Whether to run also what is done.

    Returns
    -------
    list of dict
        A row for each item, in their order.
    """
    if jobs < 1:
        raise SettingsError(f"The number of jobs is {jobs}; give 1 or more.")
    rows: dict[int, Row] = {}
    for k, item in enumerate(items):
        row = None if again else item.done()
        if row is not None:
            rows[k] = row
            told(item, row)
    groups: dict[tuple[str, int], list[int]] = {}
    for k, item in enumerate(items):
        if k not in rows:
            groups.setdefault((item.entry.name, item.seed), []).append(k)
    lock = threading.Lock()

    def hear(k: int, row: Row) -> None:
        with lock:
            rows[k] = row
            told(items[k], row)

    with _Workers() as workers, ThreadPoolExecutor(jobs) as pool:
        try:
            futures = [pool.submit(workers.serve, items, group, hear) for group in groups.values()]
            for future in futures:
                future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            workers.stop()
            raise
    return [rows[k] for k in range(len(items))]


def outcome(row: Row) -> str:
    """A row in a few words."""
    if row["status"] != "done":
        return f"failed: {row['error']}"
    ok = number(row["ok_share"], 1, scale=100.0)
    pose = number(row["coverage"], 1, scale=100.0)
    return f"ATE {number(row['ate_pct_all_frames'], 2)} % over all frames, pose in {pose} %, OK {ok} %"


def estimate(items: Iterable[Item]) -> float:
    """About how many seconds of one core the items take, by their number of frames."""
    return sum(_SECONDS_A_RUN + _SECONDS_A_FRAME * _frames(item) for item in items)


def _frames(item: Item) -> int:
    if item.entry.rendered:
        return _RENDERED_FRAMES
    try:
        return _length(item.data / item.entry.folder)
    except CollabslamError:
        return 0


@lru_cache(maxsize=64)
def _length(folder: Path) -> int:
    return len(open_recording(folder))


class _Workers:
    """The processes under way, so that they can be stopped."""

    def __init__(self) -> None:
        self._context = spawning()
        self._live: set[BaseProcess] = set()
        self._stopped = False

    def __enter__(self) -> _Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """End every process."""
        self._stopped = True
        for process in list(self._live):
            process.terminate()

    def serve(self, items: Sequence[Item], group: Sequence[int], hear: Callable[[int, Row], None]) -> None:
        """Run a group in a process; where that dies, the run under way has failed and the rest goes on."""
        left = list(group)
        while left and not self._stopped:
            ours, theirs = self._context.Pipe(duplex=False)
            process = self._context.Process(target=_serve, args=(theirs, [items[k] for k in left]))
            process.start()
            self._live.add(process)
            theirs.close()
            try:
                while left:
                    row = ours.recv()
                    hear(left.pop(0), row)
            except EOFError:
                process.join()
                if not self._stopped:
                    k = left.pop(0)
                    hear(k, items[k].failed(f"its process ended with the code {process.exitcode}"))
            finally:
                process.join()
                self._live.discard(process)


def _serve(answers: Connection, items: Sequence[Item]) -> None:
    """The work of a child process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends it
    use_one_thread()
    for item in items:
        began = time.monotonic()
        row = run_item(item)
        answers.send({**row, "seconds": time.monotonic() - began})
    answers.close()

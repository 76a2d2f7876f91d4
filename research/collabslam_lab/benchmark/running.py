"""Runs items side by side, each group of them in a process of its own, and goes on where one fails."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from pathlib import Path

from collabslam.batch.engines import LOCAL, Engine
from collabslam.batch.isolated import asking, isolated
from collabslam.datasets import open_recording
from collabslam.errors import CollabslamError, SettingsError
from collabslam.runs.report import number
from collabslam_lab.benchmark.remote import run_remotely
from collabslam_lab.benchmark.replay import clear_beside, timed_item
from collabslam_lab.benchmark.store import Item, Row

_SECONDS_A_RUN, _SECONDS_A_FRAME, _RENDERED_FRAMES = 1.5, 0.04, 100  # for the estimate of the cost

Told = Callable[[Item, Row], None]
Hear = Callable[[int, Row], None]


def run_items(
    items: Sequence[Item], *, jobs: int, told: Told, again: bool = False, engine: Engine = LOCAL
) -> list[Row]:
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
    engine : Engine
        Where it runs.

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

    try:
        if engine.is_local:
            _run_here(items, list(groups.values()), jobs, engine.seconds, hear)
        else:
            run_remotely(items, list(groups.values()), jobs=jobs, engine=engine, hear=hear, again=again)
    finally:
        clear_beside(items)
    return [rows[k] for k in range(len(items))]


def _run_here(items: Sequence[Item], groups: list[list[int]], jobs: int, seconds: float, hear: Hear) -> None:
    with asking(jobs) as (threads, stop):

        def serve(group: list[int]) -> None:
            pieces = [(items[k],) for k in group]
            with contextlib.closing(isolated(timed_item, pieces, seconds, stop)) as answers:
                for k, answer in zip(group, answers, strict=True):
                    if stop.is_set:
                        return
                    hear(k, items[k].row_of(answer))

        for future in [threads.submit(serve, group) for group in groups]:
            future.result()


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

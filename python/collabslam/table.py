"""The table of measured results: a fixed set of recordings, both modes, medians over seeds."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from collabslam.errors import CollabslamError, DataError, SettingsError
from collabslam.formats.files import write_text
from collabslam.report import markdown_table, median_of, number, step_ms
from collabslam.results import write_summary

Row = dict[str, Any]

HEADER = (
    "recording", "worn camera", "mode", "ATE, % of path", "average error, % of path", "frames OK, %", "NEES",
    "features a frame", "ms a frame", "frames", "target, px",
)  # fmt: skip
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS")


@dataclass(frozen=True)
class Entry:
    """One recording of the set.

    Attributes
    ----------
    name : str
        Folder below the data folder, or `DEMO`.
    worn : str or None
        How the worn camera is emulated; None takes the recording as it is.
    start : str
    modes : tuple of str
    seeded : bool
        Whether anything in it depends on the seed.
    available : float
        Share of the time the worn camera is there.
    settings : tuple of (str, value)
        Changes to the default settings.
    """

    name: str
    worn: str | None
    start: str = "worn"
    modes: tuple[str, ...] = ("mono", "collab", "collab-tight")
    seeded: bool = True
    available: float = 0.4
    settings: tuple[tuple[str, Any], ...] = ()


DEMO = "demo"
SET = (
    Entry(DEMO, None, modes=("mono", "mono-undelayed", "collab", "collab-tight")),
    Entry("scenes7_redkitchen", "lag:2.0"),
    Entry("hololens_000", "lag:0.7"),
    Entry("euroc_v101", "views:stereo_keyframes"),
    Entry("kitti_seq1", "rig"),
    Entry(
        "davison_monoslam",
        None,
        start="target",
        modes=("mono",),
        seeded=False,
        settings=(("frontend.target.withhold", True),),
    ),
)


@dataclass(frozen=True)
class Task:
    """One recording with one seed: what a process does in one go."""

    entry: Entry
    seed: int
    data: Path
    out: Path | None


def run_table(data: Path, *, seeds: list[int], out: Path | None, jobs: int) -> list[Row]:
    """Run the set and print the table as Markdown.

    Recordings that are missing are named and left out; one that fails keeps its message as its row.

    Parameters
    ----------
    data : Path
        Folder that holds the recordings.
    seeds : list of int
        Of the worn camera's noise, and of the demo.
    out : Path or None
        Gets ``table.json``, ``table.md`` and a result folder for each run.
    jobs : int
        Processes at a time, each with one thread.

    Returns
    -------
    list of dict
        A row for each recording, mode and seed: the keys of ``summary.json``, or ``error``.

    Raises
    ------
    DataError
        If the data folder does not exist.
    """
    if not data.is_dir():
        raise DataError(f"The data folder {data} does not exist; give the folder that holds the recordings.")
    if jobs < 1:
        raise SettingsError(f"The number of jobs is {jobs}; give 1 or more.")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    tasks = []
    for entry in SET:
        if entry.name != DEMO and not (data / entry.name).is_dir():
            print(f"{entry.name}: not in {data}, left out", flush=True)
            continue
        tasks += [Task(entry, seed, data, out) for seed in (seeds if entry.seeded else seeds[:1])]
    rows = [row for group in _run_tasks(tasks, jobs, out) for row in group]
    text = markdown(rows)
    print("\n" + text)
    if out is not None:
        write_text(out / "table.md", text + "\n")
    return rows


def markdown(rows: list[Row]) -> str:
    """Medians over the seeds, a line for each recording and mode, in the order of the set."""
    lines = []
    for entry in SET:
        for mode in entry.modes:
            runs = [r for r in rows if r["entry"] == entry.name and r["mode"] == mode]
            done = [r for r in runs if "error" not in r]
            head = [entry.name, entry.worn or ("recorded" if entry.start == "worn" else "none"), mode]
            if done:
                lines.append([*head, *_cells(done)])
            elif runs:
                lines.append([*head, *(["failed"] * (len(HEADER) - len(head)))])
    return markdown_table(HEADER, lines)


def run_task(task: Task) -> list[Row]:
    """Every mode of one recording and seed; also the work of a child process."""
    rows: list[Row] = []
    for mode in task.entry.modes:
        row: Row = {"entry": task.entry.name, "mode": mode, "seed": task.seed}
        try:
            rows.append({**_run_mode(task, mode), **row})
        except CollabslamError as error:
            rows.append({**row, "error": str(error)})
    return rows


def _run_mode(task: Task, mode: str) -> Row:
    from collabslam.datasets import attach_worn, open_recording
    from collabslam.demo.recording import corridor_recording
    from collabslam.runner import run
    from collabslam.settings import Settings
    from collabslam.types import Recording

    entry = task.entry
    recording: Recording
    if entry.name == DEMO:
        recording = corridor_recording(task.seed)
    else:
        recording = open_recording(task.data / entry.name)
        if entry.worn is not None:
            recording = attach_worn(recording, entry.worn, available=entry.available, seed=task.seed)
    folder = None if task.out is None else task.out / f"{entry.name}-{mode}-seed{task.seed}"
    options = {"worn": entry.worn, "worn_available": entry.available if entry.worn else None}
    return run(
        recording,
        mode=mode,
        start=entry.start,
        settings=Settings.default().replace(dict(entry.settings)),
        out=folder,
        seed=task.seed,
        progress=False,
        options=options,
    ).summary


def _run_tasks(tasks: list[Task], jobs: int, out: Path | None) -> list[list[Row]]:
    """The rows of each task, in the order of the tasks; ``table.json`` grows as they come in."""
    done: list[list[Row]] = [[] for _ in tasks]
    for variable in _THREAD_VARIABLES:
        os.environ[variable] = "1"
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=spawn, initializer=_one_thread) as pool:
        futures = {pool.submit(run_task, task): k for k, task in enumerate(tasks)}
        for future in as_completed(futures):
            k = futures[future]
            done[k] = future.result()
            for row in done[k]:
                print(f"{row['entry']} {row['mode']} seed {row['seed']}: {_outcome(row)}", flush=True)
            if out is not None:
                write_summary(out / "table.json", {"rows": [row for group in done for row in group]})
    return done


def _one_thread() -> None:
    import cv2

    cv2.setNumThreads(1)


def _outcome(row: Row) -> str:
    if "error" in row:
        return f"failed: {row['error']}"
    return f"ATE {number(row['ate_pct'], 2)} % of the path, OK {number(row['ok_share'], 1, scale=100.0)} %"


def _cells(runs: list[Row]) -> list[str]:
    times = [{"ms": step_ms(r)} for r in runs]
    return [
        number(median_of(runs, "ate_pct"), 2),
        number(median_of(runs, "avg_error_pct"), 2),
        number(median_of(runs, "ok_share"), 1, scale=100.0),
        number(median_of(runs, "nees_mean"), 1),
        number(median_of(runs, "features_per_frame"), 1),
        number(median_of(times, "ms"), 1),
        number(median_of(runs, "frames"), 0),
        number(median_of(runs, "target_residual_max_px"), 1),
    ]

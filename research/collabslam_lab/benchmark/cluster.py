"""What the Dask engine costs, loses and changes: the same replays here, on workers, and on dying workers."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from collabslam.batch.engines import LOCAL, Engine
from collabslam.datasets import write_recording
from collabslam.errors import DataError
from collabslam.formats.files import write_text
from collabslam.runs.results import COVARIANCE, MAP, TRAJECTORY, write_summary
from collabslam.simulation import corridor_recording
from collabslam_lab.benchmark.plan import Plan, parse_plan
from collabslam_lab.benchmark.running import run_items
from collabslam_lab.benchmark.store import Item, Row
from collabslam_lab.report import markdown_table

_PLAN = """
seeds: 0-{last}
defaults: {{available: 0.4, modes: [mono, collab-tight]}}
recordings: {{walk: {{worn: "lag:0.3"}}}}
"""
KILL_EVERY = 4
"""Answers after which a worker is killed."""


def measure_cluster(
    out: Path, *, replays: int, jobs: int, tasks: int, length_m: float = 15.0, scheduler: str | None = None
) -> dict[str, Any]:
    """Measures, and writes ``cluster.json`` and ``cluster.md``.

    Parameters
    ----------
    out : Path
    replays : int
        Of the demo's corridor, each twice: in two modes.
    jobs : int
        Processes, and workers where no scheduler is named.
    tasks : int
        Of next to no work, by which it is told how many workers one scheduler can keep busy.
    length_m : float
        Of the corridor.
    scheduler : str, optional
        Of a cluster that is there; its workers are not killed.

    Returns
    -------
    dict
        ``overhead_pct``: time of the clock for each second that replays took by themselves, over that of
        local processes, so that what else the machine does is in neither; ``overhead_running_pct``: the same
        without ``start_seconds``, which pass once until workers answer; ``identical``, ``lost``,
        ``workers_killed``, ``tasks_per_second``, ``seconds_for_1000_workers`` (the shortest replay with which
        one scheduler keeps 1000 workers at work).

    Raises
    ------
    DataError
        If no replay could be run.
    """
    data = out / "data"
    if not data.is_dir():
        write_recording(corridor_recording(0, length_m=length_m), data / "walk")
    plan = parse_plan(_PLAN.format(last=max(0, replays - 1)))
    dask = Engine("dask", scheduler)
    start, rate = _start_and_rate(dask, jobs, tasks)
    seconds, shares, rows = {}, {}, {}
    for name, engine in (("local", LOCAL), ("dask", dask)):
        began = time.monotonic()
        rows[name] = _run(plan, data, out / name, jobs, engine)
        seconds[name] = time.monotonic() - began
        busy = sum(row.get("seconds", 0.0) for row in rows[name])
        if not busy:
            raise DataError(f"No replay could be run: {rows[name][0]['error']}")
        shares[name] = seconds[name] / busy
    same = _same(plan, data, out, "dask")
    killed: list[int] = []
    if scheduler is None:
        few = parse_plan(_PLAN.format(last=max(0, replays // 2 - 1)))
        rows["killed"] = _run(few, data, out / "killed", jobs, dask, _killer(killed))
        same = same and _same(few, data, out, "killed")
    running = shares["dask"] * (1.0 - start / seconds["dask"])
    results = {
        "replays": len(rows["local"]),
        "jobs": jobs,
        "seconds": seconds,
        "overhead_pct": 100.0 * (shares["dask"] / shares["local"] - 1.0),
        "overhead_running_pct": 100.0 * (running / shares["local"] - 1.0),
        "identical": same,
        "lost": sum(row["status"] != "done" for name in rows for row in rows[name]),
        "workers_killed": len(killed),
        "start_seconds": start,
        "tasks_per_second": rate,
        "seconds_for_1000_workers": 1000.0 / rate,
    }
    write_summary(out / "cluster.json", results)
    write_text(out / "cluster.md", cluster_markdown(results) + "\n")
    return results


def _items(plan: Plan, data: Path, out: Path) -> list[Item]:
    return [
        Item(entry, mode, seed, data, out)
        for entry in plan.recordings
        for seed in entry.seeds(plan.seeds)
        for mode in entry.modes
    ]


def _run(
    plan: Plan,
    data: Path,
    out: Path,
    jobs: int,
    engine: Engine,
    told: Callable[[Item, Row], None] = lambda *_: None,
) -> list[Row]:
    return run_items(_items(plan, data, out), jobs=jobs, told=told, again=True, engine=engine)


def _killer(killed: list[int]) -> Callable[[Item, Row], None]:
    """Kills a worker of this process now and then; notes whom."""
    import psutil

    answers: list[str] = []

    def kill(item: Item, _: Row) -> None:
        answers.append(item.title)
        if len(answers) % KILL_EVERY:
            return
        workers = [p for p in psutil.Process().children() if "spawn_main" in " ".join(p.cmdline())]
        if workers:
            killed.append(workers[0].pid)
            os.kill(workers[0].pid, signal.SIGKILL)

    return kill


def _same(plan: Plan, data: Path, out: Path, name: str) -> bool:
    """Whether every result is that of this machine, to the byte."""
    pairs = zip(_items(plan, data, out / "local"), _items(plan, data, out / name), strict=True)
    return all(
        (a.folder / file).read_bytes() == (b.folder / file).read_bytes()
        for a, b in pairs
        if a.folder is not None and b.folder is not None
        for file in (TRAJECTORY, COVARIANCE, MAP)
    )


def _start_and_rate(engine: Engine, jobs: int, count: int) -> tuple[float, float]:
    """Seconds until there is a worker that answers, and tasks of no work a second from then on."""
    began = time.monotonic()
    with engine.workers(jobs) as workers:
        workers.submit(int, 0).result()
        ready = time.monotonic()
        for future in [workers.submit(int, k) for k in range(count)]:
            future.result()
        return ready - began, count / (time.monotonic() - ready)


def cluster_markdown(results: dict[str, Any]) -> str:
    """The table of the documentation."""
    rows = [
        ("replays", f"{results['replays']}"),
        ("processes or workers", f"{results['jobs']}"),
        ("seconds, local and dask", f"{results['seconds']['local']:.1f}, {results['seconds']['dask']:.1f}"),
        ("overhead, the start of the workers in it", f"{results['overhead_pct']:.1f} %"),
        ("overhead without it", f"{results['overhead_running_pct']:.1f} %"),
        ("seconds until the workers answer", f"{results['start_seconds']:.1f}"),
        ("trajectory, covariance and map identical to the byte", "yes" if results["identical"] else "NO"),
        ("workers killed meanwhile, in a third run", f"{results['workers_killed']}"),
        ("replays lost", f"{results['lost']}"),
        ("tasks of no work that the scheduler hands out a second", f"{results['tasks_per_second']:.0f}"),
        (
            "seconds of a replay from which on it keeps 1000 workers at work",
            f"{results['seconds_for_1000_workers']:.1f}",
        ),
    ]
    return markdown_table(("what", "measured"), rows)

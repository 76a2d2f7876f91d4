"""Runs the jobs that are not done, and keeps the table as it grows."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

from collabslam.batch.engines import LOCAL, Engine
from collabslam.batch.isolated import why
from collabslam.batch.job import NUMBERS, Job, row_of, run_job
from collabslam.errors import SettingsError
from collabslam.formats.files import write_text
from collabslam.runs.summary import Summary, is_trusted

TABLE = "batch.csv"
COLUMNS = ("recording", "mode", "status", "trusted", "why", *NUMBERS)
Row = dict[str, Any]


def run_batch(
    jobs: Sequence[Job],
    *,
    processes: int = 1,
    engine: Engine = LOCAL,
    again: bool = False,
    told: Callable[[Job, Row], None] = lambda job, row: None,
) -> list[Row]:
    """Run each job in a process of its own; what is done, and still holds, is not done again.

    Parameters
    ----------
    jobs : sequence of Job
        Of one folder, in which ``batch.csv`` has a row for each, as soon as it is known.
    processes : int
        At a time, on this machine.
    engine : Engine
        Where they run.
    again : bool
        Whether to run also what is done.
    told : callable
        Is given each job and its row as it comes in.

    Returns
    -------
    list of dict
        A row for each, in their order; of one that failed with the reason.

    Raises
    ------
    SettingsError
        If the number of processes is below 1, or two jobs have one result folder.
    """
    if processes < 1:
        raise SettingsError(f"The number of jobs is {processes}; give 1 or more.")
    folders = [job.folder for job in jobs]
    if len(set(folders)) < len(folders):
        raise SettingsError("Two runs of the plan have one result folder; give the recordings other names.")
    rows: dict[int, Row] = {}

    def hear(k: int, answer: Summary | Exception) -> None:
        if isinstance(answer, Exception):
            rows[k] = row_of(jobs[k], answer, why(answer)) | {"trusted": False}
        else:
            rows[k] = row_of(jobs[k], answer) | {"trusted": is_trusted(answer)}
        _write_table(jobs[k].out / TABLE, [rows[i] for i in sorted(rows)])
        told(jobs[k], rows[k])

    left = []
    for k, job in enumerate(jobs):
        found = None if again else job.done()
        if found is None:
            left.append(k)
        else:
            hear(k, found)
    if left:
        with engine.pool(processes) as pool:
            places = {pool.submit(run_job, replace(jobs[k], out=jobs[k].out.resolve())): k for k in left}
            for future in as_completed(places):
                error = future.exception()
                if error is not None and not isinstance(error, Exception):
                    raise error
                hear(places[future], future.result() if error is None else error)
    return [rows[k] for k in range(len(jobs))]


def _write_table(path: Path, rows: Sequence[Row]) -> None:
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, lineterminator="\n", restval="")
    table.writeheader()
    table.writerows(rows)
    write_text(path, text.getvalue())

"""``collabslam batch``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from collabslam.cli import NOT_TRUSTED, OK, options
from collabslam.cli.engine_options import add_engine, engine_of


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "plan", metavar="PLAN", type=Path, help="YAML: recordings, modes and settings (see Batches)"
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("results/batch"), help=options.OUT_HELP
    )
    parser.add_argument("--jobs", metavar="N", type=int, default=1, help="processes at a time (default 1)")
    parser.add_argument("--again", action="store_true", help="run also what is done")
    add_engine(parser)


def main(arguments: argparse.Namespace) -> int:
    """Run what is not done, print the table."""
    from collabslam.batch.job import Job, jobs_of
    from collabslam.batch.plan import read_plan
    from collabslam.batch.running import TABLE, run_batch

    jobs = jobs_of(read_plan(arguments.plan), arguments.out)
    heard = []

    def told(job: Job, row: dict[str, Any]) -> None:
        heard.append(row)
        said = f"failed: {row['why']}" if row["status"] == "failed" else "done"
        print(f"{len(heard)}/{len(jobs)} {job.title}: {said}", file=sys.stderr, flush=True)

    rows = run_batch(
        jobs, processes=arguments.jobs, engine=engine_of(arguments), again=arguments.again, told=told
    )
    print(f"{'recording':24} {'mode':14} {'frames':>6} {'with a pose':>11} {'ATE, %':>7}  trusted")
    for row in rows:
        print(f"{row['recording']:24} {row['mode']:14} {_shown(row)}")
    failed = sum(row["status"] == "failed" for row in rows)
    print(f"{len(rows)} runs, {failed} of them failed; the table is {arguments.out / TABLE}")
    return OK if all(row["trusted"] for row in rows) else NOT_TRUSTED


def _shown(row: dict[str, Any]) -> str:
    if row["status"] == "failed":
        return f"failed: {row['why']}"
    ate = row["ate_pct_all_frames"]
    error = "-" if ate is None else f"{ate:.2f}"
    return (
        f"{row['frames']:6} {100.0 * row['coverage']:10.1f}% {error:>7}  {'yes' if row['trusted'] else 'no'}"
    )

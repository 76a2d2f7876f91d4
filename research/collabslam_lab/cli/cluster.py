"""``collabslam-lab cluster``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import NOT_TRUSTED, OK, options


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("results/cluster"), help=options.OUT_HELP
    )
    parser.add_argument("--replays", metavar="N", type=int, default=10, help="in two modes each (default 10)")
    parser.add_argument("--jobs", metavar="N", type=int, default=2, help="processes, workers (default 2)")
    parser.add_argument(
        "--tasks", metavar="N", type=int, default=5000, help="of next to no work (default 5000)"
    )
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="of a Dask cluster (default: workers of this machine)"
    )


def main(arguments: argparse.Namespace) -> int:
    """Measure, print the table."""
    from collabslam.errors import SettingsError
    from collabslam_lab.benchmark.cluster import cluster_markdown, measure_cluster

    for name in ("replays", "jobs", "tasks"):
        if getattr(arguments, name) < 1:
            raise SettingsError(f"--{name} is {getattr(arguments, name)}; give 1 or more.")
    results = measure_cluster(
        arguments.out,
        replays=arguments.replays,
        jobs=arguments.jobs,
        tasks=arguments.tasks,
        scheduler=arguments.scheduler,
    )
    print(cluster_markdown(results))
    return OK if results["identical"] and not results["lost"] else NOT_TRUSTED

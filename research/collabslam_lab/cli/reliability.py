"""``collabslam-lab reliability``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import NOT_TRUSTED, OK


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "parts",
        metavar="PART",
        nargs="*",
        default="all",
        choices=["attacks", "faults", "lengths", "readers", "live", "core", "endurance", "kills", "all"],
        help="attacks, faults, lengths (of T_CF), readers (of files), live (messages), core, endurance, "
        "kills or all (default)",
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        default=Path("results/reliability.json"),
        help="results of other parts in it are kept",
    )
    parser.add_argument("--full", action="store_true", help="the full amounts, which take an hour or more")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of everything random (default 0)")
    parser.add_argument("--jobs", metavar="N", type=int, default=2, help="attacks at a time (default 2)")
    parser.add_argument(
        "--driver",
        metavar="PROGRAM",
        type=Path,
        help="the built fuzz program of the source tree, for the core",
    )


def main(arguments: argparse.Namespace) -> int:
    """Measure, write the file, print the page's tables."""
    from collabslam.errors import SettingsError
    from collabslam_lab.reliability.measure import PARTS, measure

    parts = list(PARTS) if "all" in arguments.parts else list(dict.fromkeys(arguments.parts))
    if arguments.jobs < 1:
        raise SettingsError(f"--jobs is {arguments.jobs}; give 1 or more.")
    good = measure(
        parts,
        arguments.out,
        full=arguments.full,
        seed=arguments.seed,
        jobs=arguments.jobs,
        driver=arguments.driver,
    )
    return OK if good else NOT_TRUSTED

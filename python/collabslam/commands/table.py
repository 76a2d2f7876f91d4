"""``collabslam table``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.commands import LOST, OK, options


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("data", metavar="DATA_DIR", type=Path, help="folder that holds the recordings")
    parser.add_argument("--seeds", metavar="A-B", type=options.seed_list, default="0-4", help="default 0-4")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("results/table"), help=options.OUT_HELP
    )
    parser.add_argument("--jobs", metavar="N", type=int, default=2, help="processes at a time (default 2)")


def main(arguments: argparse.Namespace) -> int:
    """Measure, print the table."""
    from collabslam.table import run_table

    rows = run_table(arguments.data, seeds=arguments.seeds, out=arguments.out, jobs=arguments.jobs)
    return LOST if any("error" in row for row in rows) else OK

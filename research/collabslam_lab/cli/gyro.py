"""``collabslam-lab gyro``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import OK, options
from collabslam.cli.engine_options import add_engine, engine_of


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    from collabslam_lab.gyro.simulated import KINDS

    parser.add_argument("--quick", action="store_true", help="one world of each group, its first frames")
    parser.add_argument(
        "--seeds", metavar="A-B", type=options.seed_list, help="of all noise (default 0-9, or 0 if --quick)"
    )
    parser.add_argument(
        "--kind", choices=tuple(KINDS), default="phone", help="how good the sensor is (default phone)"
    )
    parser.add_argument("--jobs", metavar="N", type=int, default=1, help="processes at a time (default 1)")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("gyro"), help="folder for gyro.json and the runs"
    )
    add_engine(parser)


def main(arguments: argparse.Namespace) -> int:
    """Run the worlds, write ``gyro.json``, print the table."""
    from collabslam_lab.gyro import study_gyro

    study_gyro(
        arguments.out,
        seeds=arguments.seeds,
        kind=arguments.kind,
        jobs=arguments.jobs,
        quick=arguments.quick,
        engine=engine_of(arguments),
    )
    return OK

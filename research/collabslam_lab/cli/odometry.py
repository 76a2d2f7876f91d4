"""``collabslam-lab odometry``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from collabslam.cli import OK, options
from collabslam.formats.files import write_text


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--worlds",
        metavar="A,B",
        type=lambda text: text.split(","),
        default=["b", "turn90-0"],
        help="rendered worlds, as collabslam-lab worlds lists them (default b,turn90-0)",
    )
    parser.add_argument(
        "--seeds", metavar="A-B", type=options.seed_list, default=[0, 1], help="of the noise (default 0-1)"
    )
    parser.add_argument(
        "--out", metavar="FILE", type=Path, default=Path("odometry.json"), help="JSON to write"
    )


def main(arguments: argparse.Namespace) -> int:
    """Write every run's figures, and print the table of medians."""
    from collabslam_lab.hardware.odometry import medians, odometry_rows

    rows = []
    for row in odometry_rows(arguments.worlds, arguments.seeds):
        rows.append(row)
        write_text(arguments.out, json.dumps(rows, indent=1) + "\n")  # what is there is kept
    print(medians(rows))
    return OK

"""``collabslam-lab costs``."""

from __future__ import annotations

import argparse

from collabslam.cli import OK, options


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--seeds", metavar="A-B", type=options.seed_list, default=[0, 1, 2], help="of the noise (default 0-2)"
    )
    parser.add_argument("--max-frames", metavar="N", type=int, help="only so many frames of each walk")


def main(arguments: argparse.Namespace) -> int:
    """Print the table."""
    from collabslam_lab.hardware.costs import costs

    print(costs(arguments.seeds, arguments.max_frames))
    return OK

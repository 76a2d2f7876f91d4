"""``collabslam-lab clocks``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import OK, options


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--seeds", metavar="A-B", type=options.seed_list, default=[0, 1, 2], help="of the noise (default 0-2)"
    )
    parser.add_argument(
        "--quick", action="store_true", help="few clocks and offsets, and two seconds: to see that it works"
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("results/clocks"), help=options.OUT_HELP
    )


def main(arguments: argparse.Namespace) -> int:
    """Write clocks.png, .csv, .json and .md, print the page."""
    from collabslam.extras import needs

    with needs("plot"):
        from collabslam_lab.hardware.clock_finding import report
    report(arguments.out, arguments.seeds, quick=arguments.quick)
    return OK

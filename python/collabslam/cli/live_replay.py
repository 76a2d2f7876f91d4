"""``collabslam live replay``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import OK, options
from collabslam.cli.drawn import draw
from collabslam.cli.live_robot import report


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("record", metavar="RECORD", type=Path, help="what 'live robot --record' wrote")
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("results/replay"),
        help=options.OUT_HELP + options.KEPT_HELP,
    )
    parser.add_argument("--overwrite", action="store_true", help=options.OVERWRITE_HELP)


def main(arguments: argparse.Namespace) -> int:
    """Run it and say what came out."""
    from collabslam.live.replay import replay
    from collabslam.runs.busy import busy

    with busy("going through the record"):
        summary = replay(arguments.record, arguments.out, overwrite=arguments.overwrite)
    print(report(summary))
    draw(Path(summary["folder"]))
    return OK

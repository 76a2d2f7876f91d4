"""``collabslam-lab evidence``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import NOT_TRUSTED, OK, options
from collabslam.cli.engine_options import add_engine, engine_of
from collabslam_lab.cli.evaluate import names


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    from collabslam_lab.evidence.parts import PARTS

    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    lines = ["parts, in the order in which they are made:", *(f"  {p.name:14} {p.question}" for p in PARTS)]
    parser.epilog = "\n".join(lines)
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("results/evidence"), help=options.OUT_HELP
    )
    parser.add_argument(
        "--data", metavar="DIR", type=Path, help="folder that holds the recordings, as of evaluate"
    )
    parser.add_argument("--only", metavar="PART,..", type=names, default=(), help="only these parts")
    parser.add_argument(
        "--quick", action="store_true", help="a small piece of each part: to see that it works"
    )
    parser.add_argument("--jobs", metavar="N", type=int, default=2, help="processes at a time (default 2)")
    parser.add_argument(
        "--tables", metavar="DIR", type=Path, help="put the tables there too: docs/tables of the source tree"
    )
    add_engine(parser)


def main(arguments: argparse.Namespace) -> int:
    """Make the parts, the archive and the tables."""
    from collabslam_lab import evidence

    asked = evidence.Asked(
        data=arguments.data,
        only=arguments.only,
        quick=arguments.quick,
        jobs=arguments.jobs,
        engine=engine_of(arguments),
        tables=arguments.tables,
    )
    results = evidence.gather(arguments.out, asked)
    return NOT_TRUSTED if any(p["status"] == "failed" for p in results["parts"].values()) else OK

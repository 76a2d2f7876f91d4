"""``collabslam reproduce``."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from collabslam.commands import OK, options


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    from collabslam.reproduce import EXPERIMENTS
    from collabslam.reproduce.settings import SIMULATION

    lines = [f"  {name:14} {text}" for name, text in EXPERIMENTS.items()]
    settings = [
        f"  {key}={entry.default:g}{' ' + entry.unit if entry.unit else ''}: {entry.doc}"
        for key, entry in SIMULATION.items()
    ]
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "\n".join(["names:", *lines, "", "settings of the simulation:", *settings])
    parser.add_argument(
        "names", metavar="NAME", nargs="+", choices=[*EXPERIMENTS, "all"], help="see below, or all"
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("results/reproduce"), help=options.OUT_HELP
    )
    parser.add_argument("--runs", metavar="N", type=int, default=200, help="Monte Carlo runs (default 200)")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of all noise (default 0)")
    parser.add_argument("--jobs", metavar="N", type=int, help="processes at a time (default: all cores)")
    parser.add_argument(
        "--set",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="change one setting of the simulation, as listed below; may be repeated",
    )


def main(arguments: argparse.Namespace) -> int:
    """Run the experiments, write their files, print their pages."""
    from collabslam.reproduce import EXPERIMENTS, reproduce
    from collabslam.settings import parse_assignments

    reproduce(
        list(EXPERIMENTS) if "all" in arguments.names else list(dict.fromkeys(arguments.names)),
        arguments.out,
        runs=arguments.runs,
        seed=arguments.seed,
        jobs=(os.cpu_count() or 1) if arguments.jobs is None else arguments.jobs,
        changes=parse_assignments(arguments.set),
    )
    return OK

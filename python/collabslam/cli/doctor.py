"""``collabslam doctor``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import OK


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("run", metavar="RUN", type=Path, help="result folder of a run")


def main(arguments: argparse.Namespace) -> int:
    """Print a sentence for each thing that went wrong."""
    from collabslam.checks.doctor import diagnose
    from collabslam.runs.run_folder import RunFolder

    for sentence in diagnose(RunFolder(arguments.run)):
        print(f"- {sentence}")
    return OK

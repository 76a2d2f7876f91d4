"""The command line of the lab, with the parser and the exit statuses of the product's."""

from __future__ import annotations

from collections.abc import Sequence

from collabslam.cli.main import build_parser, run_command
from collabslam_lab.cli import COMMANDS

DESCRIPTION = "What proves collabslam: benchmarks, the paper's experiments, rendered worlds, reliability."


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command of ``collabslam-lab``; returns the exit status."""
    return run_command(build_parser("collabslam-lab", DESCRIPTION, "collabslam_lab.cli", COMMANDS), argv)

"""``collabslam-lab peers``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import OK, options
from collabslam_lab.cli.evaluate import names


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("data", metavar="DATA_DIR", type=Path, help="folder that holds the recordings")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("results/peers"), help=options.OUT_HELP
    )
    parser.add_argument(
        "--plan", metavar="FILE", type=Path, help="recordings and their worn cameras, as of evaluate"
    )
    parser.add_argument("--only", metavar="NAME,..", type=names, default=(), help="only these recordings")
    parser.add_argument(
        "--systems", metavar="NAME,..", type=names, default=(), help="only these, as peers.json calls them"
    )
    parser.add_argument(
        "--envs", metavar="FOLDER", type=Path, help="of the systems' environments (default: the user's cache)"
    )
    parser.add_argument(
        "--offline-frames", metavar="N", type=int, default=100, help="for COLMAP at most (default 100)"
    )
    parser.add_argument(
        "--limit", metavar="S", type=float, default=1800.0, help="seconds of a run (default 1800)"
    )


def main(arguments: argparse.Namespace) -> int:
    """Run all systems, print the table; a system that fails is a row that says why."""
    from collabslam_lab.peers.compare import Asked, compare
    from collabslam_lab.peers.scored import peers_markdown

    asked = Asked(
        plan=arguments.plan,
        only=arguments.only,
        systems=arguments.systems,
        envs=arguments.envs,
        few=arguments.offline_frames,
        seconds=arguments.limit,
    )
    print("\n" + peers_markdown(compare(arguments.data, arguments.out, asked)))
    return OK

"""``collabslam demo``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import NOT_TRUSTED, OK, options


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("results/demo"),
        help=options.OUT_HELP + options.KEPT_HELP,
    )
    parser.add_argument("--overwrite", action="store_true", help=options.OVERWRITE_HELP)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--seed", metavar="N", type=int, default=0, help="of the noise (default 0)")
    which.add_argument("--seeds", metavar="A-B", type=options.seed_list, help="several: medians are printed")
    parser.add_argument("--animation", metavar="FILE.gif", type=Path, help="write an animated picture")
    parser.add_argument(
        "--recording",
        metavar="DIR",
        type=Path,
        help="only write what both cameras saw, as a recording that collabslam run and all the others read",
    )
    options.add_settings(parser)


def main(arguments: argparse.Namespace) -> int:
    """Render, run both modes, print the comparison; or only write the recording."""
    if arguments.recording is not None:
        return _write(arguments)
    from collabslam.demo import run_demo
    from collabslam.runs.summary import is_trusted

    summaries = run_demo(
        arguments.out,
        seeds=arguments.seeds or [arguments.seed],
        settings=options.read_settings(arguments),
        animation=arguments.animation,
        overwrite=arguments.overwrite,
    )
    return OK if is_trusted(summaries["collab"]) else NOT_TRUSTED


def _write(arguments: argparse.Namespace) -> int:
    from collabslam.cli.record import write_folder
    from collabslam.errors import SettingsError
    from collabslam.simulation.recording import demo_recording

    if arguments.seeds or arguments.animation is not None:
        raise SettingsError("--recording writes one recording: it takes --seed, not --seeds or --animation.")
    return write_folder(demo_recording(arguments.seed), arguments.recording, overwrite=arguments.overwrite)

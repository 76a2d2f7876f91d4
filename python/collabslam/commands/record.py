"""``collabslam record``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.commands import OK, options


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser)
    options.add_worn(parser)
    parser.add_argument("out", metavar="OUT", type=Path, help="new folder")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier recording")


def main(arguments: argparse.Namespace) -> int:
    """Write the recording."""
    from collabslam.datasets import write_recording
    from collabslam.progress import Progress

    recording = options.open_with_worn(arguments)
    with Progress(len(recording), f"{recording.name} writing") as bar:
        folder = write_recording(
            recording, arguments.out, overwrite=arguments.overwrite, progress=lambda done, total: bar.update()
        )
    print(f"{len(recording)} frames are in {folder}")
    return OK

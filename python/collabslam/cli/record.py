"""``collabslam record``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from collabslam.cli import OK, options

if TYPE_CHECKING:
    from collabslam.types import Recording


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser)
    options.add_worn(parser)
    parser.add_argument("out", metavar="OUT", type=Path, help="new folder")
    parser.add_argument(
        "--bag",
        choices=("sqlite3", "mcap"),
        help="write a ROS 2 bag",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier recording")


def main(arguments: argparse.Namespace) -> int:
    """Write the recording."""
    from collabslam.runs.busy import busy

    with busy("reading the recording"):
        recording = options.source_with_worn(arguments).open()
    if arguments.bag is not None:
        return _write_bag(recording, arguments)
    return write_folder(recording, arguments.out, overwrite=arguments.overwrite)


def write_folder(recording: Recording, out: Path, *, overwrite: bool) -> int:
    """Write a recording in our own layout into the folder ``out``."""
    from collabslam.datasets import write_recording
    from collabslam.runs.progress import Progress

    with Progress(len(recording), f"{recording.name} writing") as bar:
        folder = write_recording(
            recording, out, overwrite=overwrite, progress=lambda done, total: bar.update()
        )
    print(f"{len(recording)} frames are in {folder}")
    return OK


def _write_bag(recording: Recording, arguments: argparse.Namespace) -> int:
    from collabslam.datasets.ros.writer import topics_of, write_bag
    from collabslam.runs.progress import Progress
    from collabslam.types import worn_cameras

    with Progress(len(recording), f"{recording.name} writing") as bar:
        write_bag(recording, arguments.out, storage=arguments.bag, progress=lambda done, total: bar.update())
    topics = topics_of(worn_cameras(recording))
    roles = ",".join(f"{role}={topic}" for role, topic in topics.items())
    print(f"{len(recording)} frames are in {arguments.out}; read it with --topics {roles}")
    return OK

"""``collabslam record``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from collabslam.commands import OK, options

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
        help="write a ROS 2 bag; of a world:NAME also its laser scans and attitudes, and OUT/sensors.yaml",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier recording")


def main(arguments: argparse.Namespace) -> int:
    """Write the recording."""
    from collabslam.datasets import write_recording
    from collabslam.progress import Progress

    recording = options.open_with_worn(arguments)
    if arguments.bag is not None:
        return _write_bag(recording, arguments)
    with Progress(len(recording), f"{recording.name} writing") as bar:
        folder = write_recording(
            recording, arguments.out, overwrite=arguments.overwrite, progress=lambda done, total: bar.update()
        )
    print(f"{len(recording)} frames are in {folder}")
    return OK


def _write_bag(recording: Recording, arguments: argparse.Namespace) -> int:
    from collabslam.datasets.worn_sensors import WornSensors, write_sensors
    from collabslam.formats.bag_recording import AHRS_TOPICS, SCAN_TOPIC, TOPICS, write_bag
    from collabslam.progress import Progress
    from collabslam.worn_pose import AhrsReading, LaserScan

    scans, attitudes = list[LaserScan](), list[AhrsReading]()
    sensors = None
    if recording.source.startswith("world:"):
        from collabslam.worlds import world_recording
        from collabslam.worlds.sensors import config_of, readings_of

        world = world_recording(recording.name, arguments.seed)
        read = readings_of(world, arguments.seed)
        scans, attitudes, sensors = read.scans, read.attitudes, config_of(world)
    with Progress(len(recording), f"{recording.name} writing") as bar:
        write_bag(
            recording,
            arguments.out,
            scans=scans,
            attitudes=attitudes,
            storage=arguments.bag,
            progress=lambda done, total: bar.update(),
        )
    if sensors is not None:
        topics = {name: SCAN_TOPIC.format(name) for name in sensors.scanners}
        write_sensors(arguments.out / "sensors.yaml", WornSensors(sensors, topics, dict(AHRS_TOPICS)))
    roles = ",".join(f"{role}={topic}" for role, topic in TOPICS.items())
    print(f"{len(recording)} frames are in {arguments.out}; read it with --topics {roles}")
    return OK

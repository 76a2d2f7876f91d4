"""``collabslam-lab worlds``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from collabslam.cli import OK

if TYPE_CHECKING:
    from collabslam_lab.worlds import WorldRecording


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("name", metavar="NAME", nargs="?", help="of a world; the list of them if left out")
    parser.add_argument("out", metavar="OUT", nargs="?", type=Path, help="new folder")
    parser.add_argument(
        "--bag",
        choices=("sqlite3", "mcap"),
        help="write a ROS 2 bag with laser scans and attitudes too, and OUT/sensors.yaml",
    )
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of all noise (default 0)")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier recording")


def main(arguments: argparse.Namespace) -> int:
    """List the worlds, or write one."""
    from collabslam.cli.record import write_folder
    from collabslam.errors import InputError
    from collabslam_lab.worlds import SETS, world_recording

    if arguments.name is None:
        for title, recipes in SETS.items():
            print(f"{title}: {', '.join(r.name for r in recipes)}")
        return OK
    if arguments.out is None:
        raise InputError(f"Where shall the world '{arguments.name}' go? Give a new folder after its name.")
    world = world_recording(arguments.name, arguments.seed)
    if arguments.bag is not None:
        return _write_bag(world, arguments)
    return write_folder(world, arguments.out, overwrite=arguments.overwrite)


def _write_bag(world: WorldRecording, arguments: argparse.Namespace) -> int:
    from collabslam.datasets.ros.sensors import WornSensors, write_sensors
    from collabslam.datasets.ros.writer import AHRS_TOPICS, SCAN_TOPIC, TOPICS, write_bag
    from collabslam.runs.progress import Progress
    from collabslam_lab.worlds.sensors import config_of, readings_of

    read, sensors = readings_of(world, arguments.seed), config_of(world)
    with Progress(len(world), f"{world.name} writing") as bar:
        write_bag(
            world,
            arguments.out,
            scans=read.scans,
            attitudes=read.attitudes,
            storage=arguments.bag,
            progress=lambda done, total: bar.update(),
        )
    topics = {name: SCAN_TOPIC.format(name) for name in sensors.scanners}
    write_sensors(arguments.out / "sensors.yaml", WornSensors(sensors, topics, dict(AHRS_TOPICS)))
    roles = ",".join(f"{role}={topic}" for role, topic in TOPICS.items())
    print(f"{len(world)} frames are in {arguments.out}; read it with --topics {roles}")
    return OK

"""``collabslam live robot``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from collabslam.cli import OK, options
from collabslam.cli.drawn import draw
from collabslam.cli.live_options import add_camera, add_link, add_wheels, wheels_of
from collabslam.settings.modes import MODES


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_camera(parser)
    parser.add_argument(
        "--worn-camera",
        metavar="[NAME=]FILE",
        type=options.of_person(Path),
        action="append",
        default=[],
        help="calibration of Cf; without it the run begins when a worn camera has told its own; of several "
        "persons NAME's, and may be repeated",
    )
    parser.add_argument(
        "--persons",
        metavar="NAME,..",
        type=device_names,
        default=(),
        help="several persons wear a camera: their devices' names; without it any device is the one "
        "worn camera",
    )
    parser.add_argument("--listen", metavar="HOST:PORT", help="where devices connect (default 0.0.0.0:7447)")
    parser.add_argument(
        "--sensors",
        metavar="FILE",
        type=Path,
        help="how laser scanners and two AHRSs are mounted, from which T_CF is estimated; the robot's are "
        "heard as the file's topics (ros:TOPIC or a bag as SOURCE), all others from the devices",
    )
    add_link(parser)
    add_wheels(parser)
    options.add_gyro(parser.add_argument_group("gyroscope of a recording, or a topic beside ros:TOPIC"))
    parser.add_argument("--mode", choices=MODES, help="default: the setting's")
    parser.add_argument(
        "--start",
        choices=("worn", "target", "odometry", "scale-free"),
        default="worn",
        help="where the scale comes from (default: the first overlap)",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("results/live"),
        help=options.OUT_HELP + options.KEPT_HELP,
    )
    parser.add_argument("--overwrite", action="store_true", help=options.OVERWRITE_HELP)
    parser.add_argument(
        "--resume", action="store_true", help="go on with the run in the result folder, which was killed"
    )
    parser.add_argument(
        "--checkpoint-every",
        metavar="N",
        type=int,
        default=50,
        help="frames between checkpoints, from which a killed run goes on (default %(default)s)",
    )
    parser.add_argument(
        "--record", metavar="DIR", type=Path, help="keep all that reaches the filter as a ROS 2 bag (MCAP)"
    )
    options.add_printed(parser)
    options.add_settings(parser)


def main(arguments: argparse.Namespace) -> int:
    """Run until the camera ends or Ctrl-C."""
    from collabslam.datasets.calibration import load_unmasked
    from collabslam.datasets.ros.sensors import read_sensors
    from collabslam.live import link
    from collabslam.live.cameras import open_camera
    from collabslam.live.robot import RobotNode, RobotOptions
    from collabslam.runs.busy import busy

    keys = link.keys_of(arguments.keys, insecure=arguments.insecure)
    default = "127.0.0.1" if keys is None else "0.0.0.0"
    address = link.Address.parse(arguments.listen or default)
    worn_cameras = options.by_person("--worn-camera", arguments.worn_camera)
    asked = RobotOptions(
        arguments.out,
        options.read_settings(arguments),
        mode=arguments.mode,
        start=arguments.start,
        targets=(*arguments.tag, *arguments.board),
        persons=arguments.persons,
        worn_cameras={name: load_unmasked(file) for name, file in worn_cameras.items()},
        sensors=None if arguments.sensors is None else read_sensors(arguments.sensors),
        record=arguments.record,
        devices=None if keys is None else keys.devices,
        checkpoint_every=max(1, arguments.checkpoint_every),
        overwrite=arguments.overwrite,
        resume=arguments.resume,
    )
    wheels, gyro = wheels_of(arguments), options.gyro_of(arguments)
    with busy("opening the camera"):
        camera = open_camera(arguments.source, arguments.camera, arguments.topics, wheels, gyro)
    with link.open_robot(address, keys) as session:
        summary = RobotNode(session, camera, asked).run()
    print(report(summary))
    draw(Path(summary["folder"]))
    return OK


def device_names(text: str) -> tuple[str, ...]:
    """``anna,ben`` as names of devices."""
    from collabslam.errors import SettingsError
    from collabslam.live.names import device_name

    names = tuple(text.split(","))
    try:
        for name in names:
            device_name(name)
    except SettingsError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    if len(set(names)) != len(names):
        raise argparse.ArgumentTypeError(f"'{text}' names a person twice; give each name once")
    return names


def report(summary: dict[str, Any]) -> str:
    """What came out, in a few lines."""
    from collabslam.live.status_line import WITH

    lines = [f"{summary['frames']} frames"]
    for name, words in (("statuses", {}), ("links", WITH)):
        lines[0] += ", " + ", ".join(f"{v} {words.get(k, k)}" for k, v in sorted(summary[name].items()))
    lines += [f"  {k}: {v}" for k, v in sorted(summary.items()) if k.startswith(("dropped ", "no pose: "))]
    return "\n".join([*lines, f"  results are in {summary['folder']}"])

"""``collabslam calibrate-person``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import OK, options


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser)
    parser.add_argument(
        "--board",
        metavar="CxR:METRES",
        type=options.board,
        required=True,
        help="inner corners of the checkerboard, one number odd and one even, and the side of a square",
    )


def main(arguments: argparse.Namespace) -> int:
    """Print what to write under ``person:`` in the sensors file."""
    from collabslam.checks.board import board_poses
    from collabslam.datasets.ros.bag import Bag, is_bag
    from collabslam.datasets.ros.sensors import ESTIMATED, bag_sensors, read_sensors
    from collabslam.errors import DataError
    from collabslam.runs.busy import busy
    from collabslam.worn_pose import calibrate_person

    source = (arguments.topics or {}).get("t_cf", "")
    if not is_bag(arguments.source) or not source.startswith(ESTIMATED):
        raise DataError(
            "A person is calibrated from a bag with laser scans and attitudes; give it with --topics "
            "cs=TOPIC,cf=TOPIC,t_cf=sensors:FILE."
        )
    with busy("reading the recording") as tell:
        recording = options.source_of(arguments).open()
        with Bag(arguments.source) as bag:
            sensors = bag_sensors(bag, read_sensors(Path(source.removeprefix(ESTIMATED))))
        tell("where scans and attitudes have the worn camera")
        estimates = sensors.estimates(recording.times)
        tell("looking for the board in both cameras")
        poses, covariances = board_poses(recording, arguments.board)
    fit = calibrate_person(sensors.config.person, estimates, poses, covariances)
    ahead, left, up = (100.0 * x for x in fit.correction)
    print(f"# {fit.used} of {fit.given} frames fit; from where it was thought to be, the neck is")
    print(f"# {ahead:.1f} cm ahead, {left:.1f} cm to the left, {up:.1f} cm up")
    print("person:")
    for name in ("camera_height", "height_sd", "lever_sd", "bob_sd"):
        print(f"  {name}: {getattr(fit.person, name):.4f}")
    for name in ("lean", "surge", "bob"):
        first, second = getattr(fit.person, name)
        print(f"  {name}: [{first:.4f}, {second:.4f}]")
    print(f"  neck_to_camera: {list(fit.person.neck_to_camera)}")
    return OK

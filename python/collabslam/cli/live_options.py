"""Options that commands of ``collabslam live`` share."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from collabslam.cli.options import add_odometry_frame, odometry_given, topics
from collabslam.errors import SettingsError

if TYPE_CHECKING:
    from collabslam.live.wheels import WheelTopic


def add_link(parser: argparse.ArgumentParser) -> None:
    """How the link is secured."""
    group = parser.add_argument_group("link")
    group.add_argument(
        "--keys", metavar="DIR", type=Path, help="this end's folder from 'collabslam live keys'"
    )
    group.add_argument(
        "--insecure", action="store_true", help="no keys and no encryption; on 127.0.0.1 only, for trials"
    )


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Where images come from."""
    parser.add_argument(
        "source",
        metavar="SOURCE",
        help="/dev/video0, a URL of a video stream, ros:TOPIC (ROS 2), or a recording at its own pace",
    )
    parser.add_argument(
        "--camera", metavar="FILE", type=Path, help="calibration (Kalibr or OpenCV YAML) of these images"
    )
    parser.add_argument(
        "--topics", metavar="ROLE=TOPIC,...", type=topics, help="of a bag: which topic is what, as cs=/image"
    )


def add_wheels(parser: argparse.ArgumentParser) -> None:
    """What moves Cs."""
    group = parser.add_argument_group("odometry, in place of constant velocity")
    kinds = group.add_mutually_exclusive_group()
    kinds.add_argument("--odometry", metavar="TOPIC", help="the robot's odometry as nav_msgs/Odometry")
    kinds.add_argument("--twist", metavar="TOPIC", help="the same as TwistWithCovarianceStamped")
    add_odometry_frame(group)


def wheels_of(arguments: argparse.Namespace) -> WheelTopic | None:
    """What `add_wheels` asks for; raises SettingsError if its options lack the topic."""
    from collabslam.live import messages
    from collabslam.live.wheels import WheelTopic

    kinds = ((arguments.odometry, messages.ODOMETRY), (arguments.twist, messages.TWIST))
    for name, kind in kinds:
        if name:
            return WheelTopic(odometry_given(name, arguments.odometry_camera, arguments.odometry_sd), kind)
    if arguments.odometry_camera is not None or arguments.odometry_sd is not None:
        raise SettingsError("--odometry-camera and --odometry-sd belong to --odometry or --twist; give one.")
    return None

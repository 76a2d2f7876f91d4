"""Options that commands of ``collabslam live`` share."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli.options import topics


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

"""``collabslam live``: each of its commands is a module ``live_NAME`` beside this one."""

from __future__ import annotations

import argparse
from importlib import import_module

COMMANDS = {
    "robot": "run the filter on the robot's camera and what worn cameras send",
    "worn": "send a worn camera's images to the robot",
    "web": "serve two pages: a phone as the worn camera, and a live view",
    "ros": "run the filter as a node of ROS 2",
    "keys": "make the certificates by which robot and devices know each other",
    "replay": "run a record of a live run again, to the last bit",
}
"""Every command with its help."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the commands."""
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=argparse.ArgumentParser)
    for name, text in COMMANDS.items():
        module = import_module(f"collabslam.cli.live_{name}")
        command = subparsers.add_parser(name, help=text, description=text)
        module.configure(command)
        command.set_defaults(live=module.main)


def main(arguments: argparse.Namespace) -> int:
    """Do what the command says."""
    status: int = arguments.live(arguments)
    return status

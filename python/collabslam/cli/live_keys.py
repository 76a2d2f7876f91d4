"""``collabslam live keys``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import OK


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("folder", metavar="DIR", type=Path, help="where keys are made, and more may be later")
    parser.add_argument(
        "--robot",
        metavar="HOST",
        action="append",
        default=[],
        help="name or address by which devices reach the robot; may be repeated",
    )
    parser.add_argument(
        "--device", metavar="NAME", action="append", default=[], help="a worn camera; may be repeated"
    )
    parser.add_argument(
        "--web",
        metavar="HOST",
        action="append",
        default=[],
        help="name or address by which phones and laptops reach the pages; may be repeated",
    )


def main(arguments: argparse.Namespace) -> int:
    """Make what is missing and say where it goes."""
    from collabslam.live.keys import AUTHORITY_KEY, ROBOT, make_keys

    folders = make_keys(
        arguments.folder, hosts=arguments.robot, devices=arguments.device, web_hosts=arguments.web
    )
    for folder in folders:
        print(f"{folder}: copy this folder to {'the robot' if folder.name == ROBOT else folder.name}")
    print(f"{arguments.folder / AUTHORITY_KEY} makes more keys: keep it here and give it to nobody")
    print("a robot that runs learns of new devices when it is started again with its folder")
    return OK

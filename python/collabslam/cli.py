"""The command line: finds the command, and turns errors into one sentence and an exit status."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from collabslam.commands import BAD_INPUT, COMMANDS, INTERRUPTED, LOST
from collabslam.errors import CollabslamError, FilterError


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    parser = build_parser()
    arguments = parser.parse_args(argv)
    try:
        status: int = arguments.main(arguments)
    except CollabslamError as error:
        print(f"collabslam: error: {error}", file=sys.stderr)
        return LOST if isinstance(error, FilterError) else BAD_INPUT
    except KeyboardInterrupt:
        print("collabslam: interrupted", file=sys.stderr)
        return INTERRUPTED
    return status


def build_parser() -> argparse.ArgumentParser:
    """The whole command line; the options of a command are added when it is called."""
    parser = argparse.ArgumentParser(
        prog="collabslam",
        description="Metric monocular SLAM for a robot, helped now and then by a camera that a person wears.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and leave")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=_CommandParser)
    for name, text in COMMANDS.items():
        commands.add_parser(name, help=text, description=text, command=name)
    return parser


class _CommandParser(argparse.ArgumentParser):
    """Imports its command, and asks it for its options, when it has something to parse."""

    def __init__(self, *, command: str = "", **options: Any) -> None:
        super().__init__(**options)
        self._command = command

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        if self._command:
            module = import_module(f"collabslam.commands.{self._command.replace('-', '_')}")
            self._command = ""
            self.set_defaults(main=module.main)
            module.configure(self)
        return super().parse_known_args(args, namespace)


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from collabslam.version import version

        print(f"collabslam {version()}")
        parser.exit()

"""The command line: finds the command, and turns whatever ends it into a sentence and an exit status."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
import warnings
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, NoReturn

from collabslam.cli import BAD_INPUT, COMMANDS, INTERRUPTED, NOT_TRUSTED, TERMINATED
from collabslam.cli.fault import tell_fault
from collabslam.cli.pipes import quiet_pipes
from collabslam.errors import CollabslamError, FilterError, Terminated
from collabslam.formats.decoder_limit import limit_decoder

LONGEST_NAME = 200
DESCRIPTION = "Metric monocular SLAM for a robot, helped now and then by a camera that a person wears."


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command of ``collabslam``; returns the exit status."""
    return run_command(build_parser("collabslam", DESCRIPTION, "collabslam.cli", COMMANDS), argv)


def run_command(parser: argparse.ArgumentParser, argv: Sequence[str] | None = None) -> int:
    """Parse, call the command, and turn whatever ends it into a sentence and an exit status."""
    debug = False
    limit_decoder()
    warnings.formatwarning = lambda message, *_, **__: f"{parser.prog}: warning: {printable(message)}\n"
    with quiet_pipes():
        try:
            if threading.current_thread() is threading.main_thread():
                signal.signal(signal.SIGTERM, _terminate)
            given = sys.argv[1:] if argv is None else argv
            arguments = parser.parse_args(given or ["--help"])
            debug = arguments.debug
            status: int = arguments.main(arguments)
            sys.stdout.flush()
        except CollabslamError as error:
            print(f"{parser.prog}: error: {printable(error)}", file=sys.stderr)
            return NOT_TRUSTED if isinstance(error, FilterError) else BAD_INPUT
        except Terminated:
            print(f"{parser.prog}: terminated", file=sys.stderr)
            return TERMINATED
        except KeyboardInterrupt:
            print(f"{parser.prog}: interrupted", file=sys.stderr)
            return INTERRUPTED
        except OSError as error:
            if error.filename is None:
                return tell_fault(error, parser.prog, debug=debug)
            print(f"{parser.prog}: error: {printable(_told_by_the_system(error))}", file=sys.stderr)
            return BAD_INPUT
        except Exception as error:
            return tell_fault(error, parser.prog, debug=debug)
    return status


def printable(said: object) -> str:
    """A message as a terminal may be given it: names in it are somebody else's, and may hold its commands."""
    return "".join(
        c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in str(said)
    )


def _told_by_the_system(error: OSError) -> str:
    """What the system says of a file when it is opened: a name too long, no room, no permission."""
    name = str(error.filename)
    shown = name if len(name) <= LONGEST_NAME else f"{name[:LONGEST_NAME]}..."
    return f"The system refuses {shown} ({error.strerror}); give another place or name."


def _terminate(number: int, frame: object) -> NoReturn:
    raise Terminated


def build_parser(
    prog: str, description: str, package: str, commands: Mapping[str, str]
) -> argparse.ArgumentParser:
    """A whole command line; the options of a command are added when it is called.

    Parameters
    ----------
    prog, description : str
    package : str
        Holds a module for each command, named as the command with ``-`` as ``_``.
    commands : mapping
        Each command's help.
    """
    parser = argparse.ArgumentParser(prog=prog, description=description)
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and leave")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=_CommandParser)
    for name, text in commands.items():
        module = f"{package}.{name.replace('-', '_')}"
        subparsers.add_parser(name, help=text, description=text, module=module)
    return parser


class _CommandParser(argparse.ArgumentParser):
    """Imports its command, and asks it for its options, when it has something to parse."""

    def __init__(self, *, module: str = "", **options: Any) -> None:
        super().__init__(**options)
        self._module = module

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        if self._module:
            import_module("collabslam.extension").check_extension()
            module = import_module(self._module)
            self._module = ""
            self.set_defaults(main=module.main)
            module.configure(self)
            self.add_argument(
                "--debug", action="store_true", help="show where a fault of this program happened"
            )
        return super().parse_known_args(args, namespace)


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from collabslam.version import version

        print(f"{parser.prog} {version()}")
        parser.exit()

"""``collabslam settings show | dump | check | docs``."""

from __future__ import annotations

import argparse
import textwrap
from pathlib import Path

from collabslam.cli import BAD_INPUT, OK, options


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the actions and their options."""
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    for name, action, text in (
        ("show", _show, "list settings with value, range, and when to change them"),
        ("dump", _dump, "print a commented settings file"),
        ("check", _check, "check a settings file"),
        ("docs", _docs, "print every setting as a page of Markdown"),
    ):
        sub = actions.add_parser(name, help=text, description=text)
        sub.set_defaults(action=action)
        if action is _docs:
            continue
        if action is _check:
            sub.add_argument("config", metavar="FILE", type=Path)
            continue
        if action is _show:
            sub.add_argument("text", metavar="TEXT", nargs="?", default="", help="part of the keys wanted")
        options.add_settings(sub)


def main(arguments: argparse.Namespace) -> int:
    """Do the action."""
    status: int = arguments.action(arguments)
    return status


def _show(arguments: argparse.Namespace) -> int:
    from collabslam.runs.report import text_table
    from collabslam.settings.table import schema

    settings = options.read_settings(arguments)
    chosen = {key: setting for key, setting in schema().items() if arguments.text in key}
    if not chosen:
        print(f"No setting's name contains '{arguments.text}'.")
        return BAD_INPUT
    rows = [
        [key, str(settings[key]), f"{setting.allowed()} {setting.unit}".strip()]
        for key, setting in chosen.items()
    ]
    for line, setting in zip(text_table(rows).splitlines(), chosen.values(), strict=True):
        print(line)
        print(textwrap.fill(setting.when, 100, initial_indent="    ", subsequent_indent="    "))
    return OK


def _dump(arguments: argparse.Namespace) -> int:
    print(options.read_settings(arguments).dump(), end="")
    return OK


def _docs(arguments: argparse.Namespace) -> int:
    from collabslam.settings.table import markdown

    print(markdown(), end="")
    return OK


def _check(arguments: argparse.Namespace) -> int:
    from collabslam.settings.table import Settings

    print(f"{arguments.config} is fine; its hash is {Settings.load(arguments.config).hash()}.")
    return OK

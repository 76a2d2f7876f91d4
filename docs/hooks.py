"""Pages of the documentation that are made from their owners: commands, settings, the measured table."""

from __future__ import annotations

import io
import os
from contextlib import redirect_stdout, suppress
from pathlib import Path

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[1]


def on_files(files, config):
    """Add the generated pages."""
    from collabslam.settings.table import markdown

    pages = {"settings.md": markdown(), "commands.md": commands(), "numbers.md": numbers()}
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def commands() -> str:
    """The help of every command."""
    from collabslam.cli import COMMANDS
    from collabslam.cli import main as cli
    from collabslam.cli.live import COMMANDS as LIVE

    os.environ["COLUMNS"] = "100"
    lines = [
        "# Commands",
        "",
        "What each command does, and its options. It worked if the exit status is 0.",
        "",
        "Exit status: 0 fine, 1 finished but not to be trusted, 2 bad input, 3 our fault, 130 and 143 "
        "stopped by a signal.",
    ]
    for name, text in (COMMANDS | {f"live {name}": text for name, text in LIVE.items()}).items():
        shown = io.StringIO()
        with redirect_stdout(shown), suppress(SystemExit):
            cli.main([*name.split(), "--help"])
        lines += ["", f"## `collabslam {name}`", "", text[0].upper() + text[1:] + ".", "", "```text"]
        lines += [shown.getvalue().rstrip(), "```"]
    return "\n".join(lines) + "\n"


def numbers() -> str:
    """What the README says was measured."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    measured = text.split("\n## Measured\n", 1)[1].split("\n## ", 1)[0].replace("](docs/", "](")
    speed = (
        "\n## Speed\n\n`make bench` times the filter alone beside OpenBLAS, by number of features; "
        "`make bench-frames` the whole frame loop, images included. Compare times within one run of one "
        "machine only.\n"
    )
    question = "\nHow far off is the pose, with the worn camera and without it, in short?\n"
    return "# Accuracy and speed\n" + question + measured + speed

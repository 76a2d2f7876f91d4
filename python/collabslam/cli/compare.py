"""``collabslam compare``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from collabslam.cli import OK

if TYPE_CHECKING:
    from collabslam.runs.runner import RunResult


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("first", metavar="RUN", type=Path, help="result folder of a run")
    parser.add_argument("second", metavar="RUN", type=Path, help="result folder of another one")
    parser.add_argument(
        "--out",
        metavar="FILE.png",
        type=Path,
        help="the picture (default: comparison.png in the folder of the second run)",
    )


def main(arguments: argparse.Namespace) -> int:
    """Print both summaries, how far apart the ways are and which settings differ; draw both ways."""
    from collabslam.extras import drawing
    from collabslam.runs.busy import busy
    from collabslam.runs.comparison import apart_text, labels, on_first, settings_text
    from collabslam.runs.read_back import read_run
    from collabslam.runs.report import side_by_side
    from collabslam.runs.results import COMPARISON

    with busy("reading both runs"):
        first, second = read_run(arguments.first), read_run(arguments.second)
    names = labels(arguments.first, arguments.second)
    print(side_by_side({name: run.summary for name, run in zip(names, (first, second), strict=True)}))
    second, frames = on_first(first, second)
    print(apart_text(first, second, frames))
    print(settings_text(arguments.first, arguments.second))
    if drawing():
        _draw(dict(zip(names, (first, second), strict=True)), arguments.out or arguments.second / COMPARISON)
    return OK


def _draw(runs: dict[str, RunResult], path: Path) -> None:
    from collabslam.runs.busy import busy
    from collabslam.viz.plot import plot_comparison

    with busy("drawing both ways"):
        plot_comparison(runs, path, title=" and ".join(runs))
    print(f"  the picture is {path}")

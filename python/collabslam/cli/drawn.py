"""The picture of a run in its folder, where pictures can be drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collabslam.runs.runner import RunResult


def draw(folder: Path, read: Callable[[Path], RunResult] | None = None) -> None:
    """Draw what a run has written into its folder.

    Parameters
    ----------
    folder : Path
    read : callable, optional
        Gives the run of the folder, where it need not be read back.
    """
    from collabslam.extras import drawing
    from collabslam.runs.busy import busy
    from collabslam.runs.read_back import read_run
    from collabslam.runs.results import PICTURE

    if drawing():
        from collabslam.viz.plot import plot_run

        with busy("drawing the way"):
            plot_run((read or read_run)(folder), folder / PICTURE)

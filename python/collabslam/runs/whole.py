"""Whether a result folder holds all of a run that ended."""

from __future__ import annotations

from pathlib import Path

from collabslam.errors import DataError
from collabslam.runs.read_back import read_run
from collabslam.runs.results import CHECKPOINT, FRAMES, SUMMARY
from collabslam.runs.run_folder import read_summary
from collabslam.runs.runner import RunResult


def read_whole(folder: Path) -> RunResult:
    """The result of a run that ended.

    Raises
    ------
    DataError
        If the run was killed or goes on, or a file is missing, damaged, or has other frames than are told.
    """
    if not (folder / SUMMARY).exists():
        on = f"'collabslam run --resume {folder}' goes on with it" if (folder / CHECKPOINT).exists() else ""
        raise DataError(
            f"The run in {folder} has no {SUMMARY}: it was killed, or goes on; "
            f"{on or 'wait for its end, or run the recording again'}."
        )
    if not read_summary(folder / SUMMARY):
        raise DataError(f"{folder / SUMMARY} holds nothing of a run; run the recording again.")
    done = read_run(folder)
    told = done.summary["frames"]
    if told != len(done.record):
        raise DataError(
            f"{folder / FRAMES} has {len(done.record)} frames, {SUMMARY} tells of {told}: it is cut; run the "
            "recording again."
        )
    return done

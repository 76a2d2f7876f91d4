"""``collabslam doctor``."""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

from collabslam.cli import NOT_TRUSTED, OK


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("run", metavar="RUN", type=Path, help="result folder of a run")


def main(arguments: argparse.Namespace) -> int:
    """Print a sentence for each thing that went wrong; the status is 1 where the run is not to be trusted."""
    from collabslam.checks.doctor import diagnose
    from collabslam.errors import CollabslamError, DataError
    from collabslam.runs.busy import busy
    from collabslam.runs.results import FRAMES, SUMMARY
    from collabslam.runs.run_folder import RunFolder
    from collabslam.runs.summary import is_trusted
    from collabslam.runs.whole import read_whole

    run = RunFolder(arguments.run)
    try:
        with busy("reading the run"), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # columns may be empty throughout
            summary = read_whole(run.path).summary
            found = diagnose(run)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, CollabslamError):
            raise
        raise DataError(f"{run.path} is damaged ({FRAMES} or {SUMMARY}); run the recording again.") from error
    for sentence in found:
        print(f"- {sentence}")
    if summary["interrupted"]:
        print(f"- The run ended before its recording did ({summary['ended_by']}); --resume goes on with it.")
    return OK if is_trusted(summary) and not summary["interrupted"] else NOT_TRUSTED

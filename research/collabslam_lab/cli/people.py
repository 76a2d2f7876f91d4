"""``collabslam-lab people``."""

from __future__ import annotations

import argparse
from pathlib import Path

from collabslam.cli import OK


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "data",
        metavar="DATA",
        type=Path,
        help="folder with .npz scans of legs and .mat trials of BROAD, or above",
    )


def main(arguments: argparse.Namespace) -> int:
    """Print a table for the scans and one for the inertial units."""
    from collabslam.errors import DataError
    from collabslam_lab.real_people import ahrs, legs
    from collabslam_lab.report import markdown_table

    scans, trials = (sorted(arguments.data.rglob(kind)) for kind in ("*.npz", "*.mat"))
    if not scans and not trials:
        raise DataError(
            f"The folder {arguments.data} holds no .npz scans and no .mat trials; give another one."
        )
    rows = []
    for path in scans:
        found = legs.judge(legs.read_legs(path))
        rows.append(
            [
                path.stem,
                _share(found.in_scan, found.annotated),
                _share(found.legs, found.annotated),
                _share(found.followed, found.asked),
                _share(found.elsewhere, found.asked),
                f"{found.made_up} of {found.tracks}",
                f"{found.way:.0%}",
            ]
        )
    if rows:
        head = [
            "scans",
            "legs in the scan",
            "not surroundings",
            "followed",
            "elsewhere",
            "made up",
            "way off",
        ]
        print(markdown_table(head, rows))
    rows = []
    for path in trials:
        errors = ahrs.judge(path)
        rows.append([path.stem, f"{errors.tilt:.2f}", f"{errors.heading:.2f}", f"{errors.carried:.2f}"])
    if rows:
        print(markdown_table(["trial", "vqf: tilt, deg", "heading, deg", "track, 20 ms ahead, deg"], rows))
    return OK


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole}" if whole else "-"

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
    rows, others = [], []
    for path in scans:
        found = legs.judge(legs.read_legs(path))
        for name, group in (("walking", found.walking), ("standing", found.standing)):
            of_all = (group.in_scan, group.legs, group.tracked)
            of_told = (group.followed, group.elsewhere)
            rows.append([path.stem, name, *(_share(n, group.annotated) for n in of_all)])
            rows[-1] += [_share(n, group.asked) for n in of_told]
        of_walkers = (found.alone, found.made_up)
        others.append([path.stem, *(_share(n, found.walkers) for n in of_walkers), f"{found.way:.0%}"])
    if rows:
        seen = ["legs in the scan", "not surroundings", "in a track"]
        print(markdown_table(["scans", "people", *seen, "told where: followed", "elsewhere"], rows))
        print(
            markdown_table(["scans", "walkers, not annotated", "nor in the scan", "robot's way off"], others)
        )
    rows = []
    for path in trials:
        errors = ahrs.judge(path)
        rows.append([path.stem, f"{errors.tilt:.2f}", f"{errors.heading:.2f}", f"{errors.carried:.2f}"])
    if rows:
        print(markdown_table(["trial", "vqf: tilt, deg", "heading, deg", "track, 20 ms ahead, deg"], rows))
    return OK


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole}" if whole else "-"

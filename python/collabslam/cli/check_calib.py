"""``collabslam check-calib``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from collabslam.cli import NOT_TRUSTED, OK, options

if TYPE_CHECKING:
    from collabslam.types import Recording


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser)
    options.add_worn(parser)
    parser.add_argument(
        "--write",
        metavar="FILE",
        type=Path,
        help="find the error that all of T_CF shares and the offset of Cf's clock, and write what corrects "
        "them, for --worn-calibration",
    )


def main(arguments: argparse.Namespace) -> int:
    """Print what was found; the status is 1 where something does not fit, or nothing could be checked."""
    from collabslam.checks.calibration import check_calibration
    from collabslam.errors import SettingsError
    from collabslam.runs.report import number, text_table

    if arguments.write is not None and arguments.worn_calibration is not None:
        raise SettingsError(
            "--write finds a correction of T_CF as it is measured; leave out --worn-calibration."
        )
    recording = options.source_with_worn(arguments).open()
    report = check_calibration(recording)
    rows = [[f"residual, frames {gap} apart", number(r, 2, "px")] for gap, r in report.by_gap.items()]
    rows += [
        ["focal length that fits best", number(report.focal, 3, "times the calibrated one")],
        ["time offset of images to poses", number(report.offset, 4, "s")],
        ["residual of Cf under T_CF", number(report.worn.residual, 2, "px")],
        ["residual that T_CF's covariance leads to", number(report.worn.expected, 2, "px")],
        ["lengths of the true poses to those of T_CF", number(report.lengths, 3, "times")],
    ]
    if report.worn.error is not None:
        metres, degrees, sigmas = report.worn.error
        text = f"{100 * metres:.1f} cm, {degrees:.2f} degrees, {sigmas:.1f} standard deviations"
        rows.append(["correction of T_CF by the images", text])
    print(recording.name)
    print(text_table(rows))
    for line in [*report.findings, *report.notes]:
        print(line)
    if report.agrees:
        print("Calibration, poses and time stamps agree with the images, as far as they were checked.")
    written = arguments.write is None or _write(recording, arguments.write)
    return OK if report.checked and not report.findings and written else NOT_TRUSTED


def _write(recording: Recording, path: Path) -> bool:
    """Find what all views share, say it, and write it; whether there was anything to write."""
    from collabslam.checks.worn_bias.recorded import lasting_error
    from collabslam.checks.worn_bias.report import believed, rows, sentences
    from collabslam.runs.report import text_table

    found = lasting_error(recording)
    if found is None:
        print("No view of Cf shares enough points with Cs on its path: nothing is written.")
        return False
    path_of = "by its true poses" if found.metric else "by a run of the filter, whose scale is open"
    print(f"\nWhat {found.fit.views} views of Cf share, along the axes of Cs, which moved as {path_of}:")
    print(text_table(rows(found.fit)))
    for line in sentences(found.fit, found.baseline):
        print(line)
    if not believed(found.fit):
        print("Nothing is written.")
        return False
    found.fit.calibration.save(path)
    print(f"Written to {path}: correct the recording with --worn-calibration {path}.")
    return True

"""``collabslam check-calib``."""

from __future__ import annotations

import argparse

from collabslam.cli import NOT_TRUSTED, OK, options


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser)
    options.add_worn(parser)


def main(arguments: argparse.Namespace) -> int:
    """Print what was found; the status is 1 where something does not fit, or nothing could be checked."""
    from collabslam.checks.calibration import check_calibration
    from collabslam.runs.report import number, text_table

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
    return OK if report.checked and not report.findings else NOT_TRUSTED

"""``collabslam check-calib``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from collabslam.cli import NOT_TRUSTED, OK, options

if TYPE_CHECKING:
    from collections.abc import Mapping

    from collabslam.checks.calibration import CalibrationReport
    from collabslam.checks.gyroscope import GyroReport
    from collabslam.checks.wheels import WheelsReport
    from collabslam.types import Recording


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    options.add_source(parser)
    options.add_worn(parser)
    options.add_odometry(parser)
    parser.add_argument(
        "--write",
        metavar="FILE",
        type=Path,
        help="find the error that all of T_CF shares and the offset of Cf's clock, and write what corrects "
        "them, for --worn-calibration",
    )


def main(arguments: argparse.Namespace) -> int:
    """Print what was found; the status is 1 where something does not fit, or nothing could be checked."""
    from collabslam.checks.calibration import check_persons
    from collabslam.checks.gyroscope import check_gyroscope, check_worn_gyroscopes
    from collabslam.checks.wheels import check_wheels
    from collabslam.errors import SettingsError
    from collabslam.runs.busy import busy
    from collabslam.runs.report import text_table
    from collabslam.types import worn_cameras

    if arguments.write is not None and arguments.worn_calibration is not None:
        raise SettingsError(
            "--write finds a correction of T_CF as it is measured; leave out --worn-calibration."
        )
    with busy("reading the recording"):
        recording = options.source_with_worn(arguments).open()
    names = list(worn_cameras(recording))
    if arguments.write is not None and len(names) > 1:
        raise SettingsError(
            f"--write finds the correction of one person's T_CF; say whose, as --worn recorded:{names[0]}."
        )
    with busy("asking the images") as tell:
        reports = check_persons(recording, tell)
        tell("turns of the images beside the gyroscope's")
        gyro = check_gyroscope(recording)
        worn_gyros = check_worn_gyroscopes(recording)
        tell("motion of the images beside the odometry's")
        wheels = check_wheels(recording)
    beside = [report for report in (gyro, *worn_gyros.values(), wheels) if report is not None]
    print(recording.name)
    first = next(iter(reports.values()))
    rows = _robot_rows(first)
    for name, report in reports.items():
        rows += [
            [f"{label}, {name}" if len(reports) > 1 else label, text] for label, text in _worn_rows(report)
        ]
    rows += _gyro_rows(gyro)
    for name, found in worn_gyros.items():
        rows += [[f"{label}, {name or 'Cf'}", text] for label, text in _gyro_rows(found)]
    print(text_table([*rows, *_wheels_rows(wheels)]))
    said = [line for report in beside for line in report.findings + report.notes]
    for line in [*_sentences(reports), *said]:
        print(line)
    if all(report.agrees for report in reports.values()):
        print("Calibration, poses and time stamps agree with the images, as far as they were checked.")
    elif all(report.checked and not report.findings for report in reports.values()):
        print("Nothing that was checked speaks against calibration, poses and time stamps.")
    if gyro is not None and gyro.agrees:
        print("The gyroscope turns as the images do: its mount and its clock fit.")
    for name in (name for name, found in worn_gyros.items() if found.agrees):
        print(f"The gyroscope of {name or 'Cf'} turns as its views do: its mount and its clock fit.")
    if wheels is not None and wheels.agrees:
        print("The odometry moves as the images do: where Cs sits on the robot fits.")
    written = arguments.write is None or _write(recording, arguments.write, "".join(names))
    checked = all(report.checked for report in reports.values()) or any(r.agrees for r in beside)
    wrong = any(report.findings for report in [*reports.values(), *beside])
    return OK if checked and written and not wrong else NOT_TRUSTED


def _robot_rows(report: CalibrationReport) -> list[list[str]]:
    from collabslam.runs.report import number

    return [
        *([f"residual, frames {gap} apart", number(r, 2, "px")] for gap, r in report.by_gap.items()),
        ["focal length that fits best", number(report.focal, 3, "times the calibrated one")],
        ["time offset of images to poses", number(report.offset, 4, "s")],
    ]


def _worn_rows(report: CalibrationReport) -> list[list[str]]:
    from collabslam.runs.report import number

    rows = [
        ["residual of Cf under T_CF", number(report.worn.residual, 2, "px")],
        ["residual that T_CF's covariance leads to", number(report.worn.expected, 2, "px")],
        ["lengths of the true poses to those of T_CF", number(report.lengths, 3, "times")],
    ]
    if report.worn.error is not None:
        metres, degrees, sigmas = report.worn.error
        text = f"{100 * metres:.1f} cm, {degrees:.2f} degrees, {sigmas:.1f} standard deviations"
        rows.append(["correction of T_CF by the images", text])
    return rows


def _gyro_rows(report: GyroReport | None) -> list[list[str]]:
    """What the images say of the gyroscope."""
    import numpy as np

    from collabslam.geometry import rotation_log
    from collabslam.runs.report import number

    if report is None or report.fit is None:
        return []
    degrees, fit, sensor = 180.0 / np.pi, report.fit, report.sensor
    rows = [
        [f"turns of {report.pairs} pairs without the gyroscope's", number(fit.left, 3, "degrees", degrees)],
        ["the same by the mount and clock that were told", number(report.told_left, 3, "degrees", degrees)],
        ["rates that fit best", number(fit.scale, 3, "times the gyroscope's")],
        ["its bias", "{:.4f} {:.4f} {:.4f} rad/s".format(*fit.bias)],
    ]
    if sensor is not None:
        off = float(np.linalg.norm(rotation_log(sensor.r_ci @ np.asarray(report.told.r_ci).T)))
        sd = number(sensor.mount_sd, 2, scale=degrees)
        rows.append(["its mount, from the one that was told", f"{degrees * off:.2f} degrees (sd {sd})"])
        clock = f"{sensor.time_offset:+.4f} s (sd {number(sensor.time_offset_sd, 4)})"
        rows.append(["added to its stamps", clock])
    return rows


def _wheels_rows(report: WheelsReport | None) -> list[list[str]]:
    """What the images say of the odometry."""
    import numpy as np

    from collabslam.runs.report import number

    if report is None or report.misfit is None:
        return []
    degrees, pairs = 180.0 / np.pi, f"of {report.pairs} pairs"
    ways, turns = (None if np.isnan(angle) else angle for angle in report.misfit)
    return [
        [f"ways {pairs} beside the odometry's", number(ways, 1, "degrees", degrees)],
        [f"axes of turns {pairs} beside the odometry's", number(turns, 1, "degrees", degrees)],
        ["turns that fit best", number(report.turn_scale, 3, "times the odometry's")],
    ]


def _sentences(reports: Mapping[str, CalibrationReport]) -> list[str]:
    """Findings, then notes; what is said of one of several persons begins with the name."""
    each = {name: [*report.findings, *report.notes] for name, report in reports.items()}
    if len(each) == 1:
        return next(iter(each.values()))
    said = list(each.values())
    of_all = [line for line in said[0] if all(line in lines for lines in said)]
    own = [f"{name}: {line}" for name, lines in each.items() for line in lines if line not in of_all]
    return [*of_all, *own]


def _write(recording: Recording, path: Path, name: str) -> bool:
    """Find what all views of a person share, say it, and write it; whether there was anything to write."""
    from collabslam.checks.worn_bias.recorded import time_correlated_error
    from collabslam.checks.worn_bias.report import believed, rows, sentences
    from collabslam.runs.busy import busy
    from collabslam.runs.report import text_table

    with busy("what all views of Cf share"):
        found = time_correlated_error(recording)
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
    given = f"{name}={path}" if name else str(path)
    print(f"Written to {path}: correct the recording with --worn-calibration {given}.")
    return True

"""Does a gyroscope agree with the images: its mount, its clock, its unit and its axes?

The rotation between frames alone tells both mount and clock (`gyro_fit`).  What was told of the sensor is
held against what the images say; the usual mistakes are named.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from collabslam._core import FilterSettings
from collabslam.checks.gyro_fit import CLEAR, Fit, Integrated, Turns, best_fit, fit_at, unexplained
from collabslam.checks.matching import describe, match_points
from collabslam.checks.mistakes import MirroredCamera
from collabslam.checks.relative_motion import relative_motion
from collabslam.checks.report import Report
from collabslam.checks.samples import spread
from collabslam.geometry import rotation_log
from collabslam.types import Array, Image, Imu, ImuLog, Recording, worn_cameras

PLACES, WORN_PLACES = 24, 60
"""Places in a recording that are asked; more of a worn camera, which is not always there."""
BETWEEN = 0.1, 0.3
"""Seconds from a frame to the two that its turns are told to, at least one and two frames."""
LEAST_PAIRS = 12
LEAST_TURN = np.deg2rad(0.6)
"""Root mean square of the turns of pairs, about the axis that they turn the second most about, from which on
they tell the mount; and about the first, from which on they tell the clock."""
FITS = np.deg2rad(1.0)
"""Root mean square residual of a pair up to which samples and images agree, or `EXPLAINED` of the turns."""
_TINY = 0.1
"""Scale below which rates may be in degrees."""
EXPLAINED = 0.3
_DEFAULTS = FilterSettings().imu
"""How well a sensor is taken to be known where nobody says."""
LEAST_SD = np.deg2rad(0.1), 5e-4
"""Standard deviations of mount and clock that no fit to images beats."""
SURE = 3.0
_OF_CF = "--worn-imu", "--worn-gyro none"
SCALE = 0.05
NEAR = np.deg2rad(10.0)
"""Angle within which a mount is one of those that a mistake makes."""


class Whose(NamedTuple):
    """What a gyroscope is called at the beginning of a sentence, and its options."""

    name: str = "The gyroscope"
    imu: str = "--imu"
    none: str = "--gyro none"


@dataclass(frozen=True)
class GyroReport(Report):
    """What was found.

    Attributes
    ----------
    told : Imu
        The sensor as it was told.
    pairs : int
        Pairs of frames whose turn the images told.
    sensor : Imu or None
        As the images have it: mount and clock with their standard deviations, all else as it was told.
    fit : Fit or None
    told_left : float or None
        What the mount and clock that were told leave of the turns, rad.
    """

    told: Imu
    pairs: int
    sensor: Imu | None = None
    fit: Fit | None = None
    told_left: float | None = None

    @property
    def agrees(self) -> bool:
        """Whether mount and clock were held against the images, and fit."""
        return self.sensor is not None and not self.findings


def check_gyroscope(recording: Recording) -> GyroReport | None:
    """Hold the gyroscope of a recording against its images; None where it has none."""
    log: ImuLog | None = getattr(recording, "imu", None)
    return None if log is None else _checked(image_turns(recording), log, Whose())


def check_worn_gyroscopes(recording: Recording) -> dict[str, GyroReport]:
    """The same of each worn camera that has one of its own, by its name; "" is the only one's."""
    logs: Mapping[str, ImuLog] = getattr(recording, "worn_imu", {})
    found = {}
    for name, log in logs.items():
        whose = Whose(f"The gyroscope of {name}'s Cf" if name else "Cf's gyroscope", *_OF_CF)
        found[name] = _checked(worn_turns(recording, name), log, whose)
    return found


def _checked(turns: Turns, log: ImuLog, whose: Whose) -> GyroReport:
    count = len(turns.first)
    if count < LEAST_PAIRS:
        text = (
            f"Only {count} pairs of images tell how the camera turned: {_small(whose.name)} is not checked."
        )
        return GyroReport(log.sensor, count, notes=[text])
    found = best_fit(turns, log)
    if found is None:
        text = f"The samples of {_small(whose.name)} and its images share too little time: it is not checked."
        return GyroReport(log.sensor, count, notes=[text])
    return _judged(turns, log, *found, whose)


def _small(name: str) -> str:
    return name.replace("The ", "the ", 1)


def image_turns(recording: Recording) -> Turns:
    """How the camera turned between pairs of frames, spread over the recording, as far as images tell."""
    times = recording.times
    model = MirroredCamera(recording.camera)
    return _turns(times, lambda i: (float(times[i]), recording.image(i)), model, PLACES)


def worn_turns(recording: Recording, name: str) -> Turns:
    """How a worn camera turned between pairs of its views."""

    def view(i: int) -> tuple[float, Image] | None:
        frame = recording.frame(i)
        found = next((v for v in frame.views if not name or v.who == name), None)
        return None if found is None else (frame.t if found.t is None else found.t, found.image)

    return _turns(recording.times, view, MirroredCamera(worn_cameras(recording)[name]), WORN_PLACES)


def _turns(
    times: Array, shot: Callable[[int], tuple[float, Image] | None], model: MirroredCamera, places: int
) -> Turns:
    """Of the shots, with their times, that come with frames."""
    rows: list[tuple[float, ...]] = []
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    near, far = (max(least, round(apart / step)) for least, apart in enumerate(BETWEEN, start=1))
    for i in spread(range(len(times) - far), places):
        first = shot(i)
        if first is None:
            continue
        points = describe(first[1])
        for k in (i + near, i + far):
            second = shot(k)
            if second is None or not second[0] > first[0]:
                continue
            motion = relative_motion(match_points(points, describe(second[1])), model)
            if motion is not None:
                rows.append((first[0], second[0], *rotation_log(motion.t_ab[:3, :3])))
    table = np.asarray(rows, np.float64).reshape(-1, 5)
    return Turns(table[:, 0], table[:, 1], table[:, 2:])


def _judged(turns: Turns, log: ImuLog, offset: float, fit: Fit, whose: Whose) -> GyroReport:
    told, count = log.sensor, len(turns.first)
    if fit.turned[0] < LEAST_TURN:
        text = f"The camera hardly turns: nothing tells mount or clock of {_small(whose.name)}."
        return GyroReport(told, count, notes=[text])
    before = _told_left(turns, log)
    report = GyroReport(log.sensor, count, None, fit, before)
    turned = float(np.sqrt(np.mean(np.sum(turns.vectors**2, axis=1))))
    misfit = fit.left > max(FITS, EXPLAINED * turned)
    if misfit or fit.scale < _TINY:
        in_radians = best_fit(turns, replace(log, rates=np.deg2rad(log.rates)))
        if in_radians is not None and in_radians[1].left < CLEAR * fit.left:
            report.findings.append(
                f"{whose.name} has rates in degrees a second: turned into rad/s (times 0.0174533) they fit "
                "the images; write them so."
            )
            return report
    if misfit:
        report.findings.append(
            f"{whose.name} does not turn as the images do, with any mount and clock: of turns of "
            f"{np.rad2deg(turned):.2f} degrees a pair {np.rad2deg(fit.left):.2f} are left; give the log that "
            "belongs to these images, and leave the gyroscope out until then ({whose.none})."
        )
        return report
    covariance = fit.left**2 * np.linalg.pinv(fit.information)
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    mount_sd, clock_sd = max(float(sd[:3].max()), LEAST_SD[0]), max(float(sd[3]), LEAST_SD[1])
    axis_only = fit.turned[1] < LEAST_TURN
    if axis_only:
        report.notes.append(
            "The camera turns about one axis alone: nothing tells the mount of "
            f"{_small(whose.name)} about it."
        )
    mistakes = [] if axis_only else list(_mistakes(fit, told, mount_sd, whose))
    wrong = before is None or fit.left < CLEAR * before
    report.findings.extend(mistakes if wrong or abs(fit.scale - 1.0) > SCALE else [])
    known = _DEFAULTS.time_offset_sd if told.time_offset_sd is None else told.time_offset_sd
    late = offset - told.time_offset
    if abs(late) > SURE * float(np.hypot(clock_sd, known)) and (wrong or not axis_only):
        report.findings.append(
            f"{whose.name} has a clock that is off: with {late:+.4f} s added to its stamps its turns fit the "
            f"images; tell 'timeshift_cam_imu: {-offset:.4f}' in {whose.imu}."
        )
    proper = float(np.linalg.det(fit.turn)) > 0.0
    if axis_only or not proper:
        return report
    found = replace(told, r_ci=fit.turn, mount_sd=mount_sd, time_offset=offset, time_offset_sd=clock_sd)
    return replace(report, sensor=found)


def _told_left(turns: Turns, log: ImuLog) -> float | None:
    """What the mount and clock that were told leave of the turns, rad; None where samples do not cover it."""
    integrated, offset = Integrated(log), log.sensor.time_offset
    g, _, known = integrated.between(turns.first - offset, turns.second - offset)
    if fit_at(turns, integrated, offset) is None:
        return None
    off = turns.vectors[known] - g[known] @ np.asarray(log.sensor.r_ci).T
    return unexplained(off, (turns.second - turns.first)[known])


def _mistakes(fit: Fit, told: Imu, mount_sd: float, whose: Whose) -> list[str]:
    """What is wrong with unit and mount, in sentences."""
    out = []
    if abs(fit.scale - 1.0) > SCALE:
        out.append(
            f"{whose.name} has rates that, times {fit.scale:.3f}, fit the images: their unit is another one, "
            "or a focal length is wrong (see above)."
        )
    r_ci = np.asarray(told.r_ci, np.float64)
    known = _DEFAULTS.mount_sd if told.mount_sd is None else told.mount_sd
    off = _angle(fit.turn @ r_ci.T) if np.linalg.det(fit.turn) > 0.0 else np.pi
    if off <= max(SURE * float(np.hypot(mount_sd, known)), np.deg2rad(1.0)):
        return out
    if np.linalg.det(fit.turn) > 0.0 and _angle(fit.turn @ r_ci) < NEAR:
        out.append(
            f"{whose.name} has a mount that is inverted: its inverse fits the images; T_cam_imu maps points "
            "of the sensor into the camera."
        )
        return out
    axes = _axes(r_ci.T @ fit.turn)
    if axes is not None:
        out.append(
            f"{whose.name} has axes that have a wrong sign or are exchanged: what its columns call x, y, z "
            f"are {axes} of the sensor that was told; put the columns in order, or tell the mount that was "
            f"found ({whose.imu})."
        )
        return out
    out.append(
        f"{whose.name} sits otherwise: {np.rad2deg(off):.1f} degrees from the mount that was told; give the "
        f"one that was found with {whose.imu} ('collabslam init' writes it)."
    )
    return out


def _angle(turn: Array) -> float:
    return float(np.linalg.norm(rotation_log(turn)))


def _axes(matrix: Array) -> str | None:
    """The axes, with their signs, that a matrix exchanges x, y and z for; None if it turns by more."""
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            swapped = np.zeros((3, 3))
            swapped[list(order), range(3)] = signs
            rest = matrix @ swapped.T
            if np.linalg.det(rest) > 0.0 and _angle(rest) < NEAR:
                names = ["-xyz"[0] * (s < 0.0) + "xyz"[o] for o, s in zip(order, signs, strict=True)]
                return ", ".join(names)
    return None

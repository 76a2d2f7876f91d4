"""Do the images of Cs agree with its calibration, its true poses and its stamps?

Matched points of two frames must lie on each other's epipolar lines under the poses given, and in front of
both.  The residual by frame gap shows calibration (all gaps) and drifting poses (growing with the gap).  The
usual mistakes are undone one after the other; of those that leave the points in front of the cameras, the one
that leaves clearly the least residual is named.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from collabslam.checks.matching import (
    BEHIND,
    LEAST_MATCHES,
    Matches,
    Points,
    describe,
    epipolar_residuals,
    in_front,
    match_points,
    share_in_front,
)
from collabslam.checks.mistakes import (
    FOCALS,
    MIRRORS,
    SIZES,
    TRUE_POSE_MISTAKES,
    MirroredCamera,
    body_mistakes,
)
from collabslam.checks.report import Report
from collabslam.checks.samples import CLEAR_GAIN, least, spread
from collabslam.datasets.poses import interpolate_track
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Recording

GAPS = (1, 2, 5, 10, 20)
PAIRS_PER_GAP = 6
LEAST_BASELINE = 0.01
FINE_PX = 1.5
"""Largest median residual at which poses and calibration count as fitting the images."""
FOCAL_TOLERANCE = 0.02
OFFSET_TOLERANCE = 0.25
"""Largest time offset that counts as none, as a share of the time between frames."""
CLOCK = 0.3
"""Clocks are tried this far apart, or three frames, seconds."""


class Pair(NamedTuple):
    """Two frames of Cs and what matches between them."""

    i: int
    j: int
    matches: Matches


@dataclass(frozen=True)
class RobotReport(Report):
    """What was found of Cs; residuals are medians, pixels.

    Attributes
    ----------
    by_gap : dict of frame gap to residual under the true poses
    focal : float or None
        Factor on the focal lengths that fits best.
    offset : float or None
        Seconds to add to the image stamps of Cs so that the poses fit best.
    model : MirroredCamera
        The camera with the mistake undone that was found, or as given.
    poses : (N, 4, 4) float64 or None
        The true poses with the mistake undone that was found, or as given.
    """

    model: MirroredCamera
    by_gap: dict[int, float] = field(default_factory=dict)
    focal: float | None = None
    offset: float | None = None
    poses: Array | None = None


class _Trial(NamedTuple):
    """A mistake that may have been made, and camera and poses without it."""

    fault: str
    remedy: str
    model: MirroredCamera
    poses: Array


def check_robot(recording: Recording) -> RobotReport:
    """Hold Cs's images against its true poses."""
    truth, model = recording.truth, MirroredCamera(recording.camera)
    if truth is None:
        return RobotReport(
            model, notes=["There are no true poses (--poses) to hold the images of Cs against."]
        )
    points: dict[int, Points] = {}
    pairs = {gap: found for gap in GAPS if (found := _pairs(recording, truth, gap, points))}
    if not pairs:
        text = (
            f"No two frames with poses are {100 * LEAST_BASELINE:.0f} cm apart and share {LEAST_MATCHES} "
            "points: calibration and stamps of Cs are not held against the poses."
        )
        return RobotReport(model, notes=[text])
    every = [p for found in pairs.values() for p in found]
    now = residual(every, model, truth)
    focal = least(lambda f: residual(every, model.with_focal(f), truth), FOCALS, 1.0)
    offset = _offset(recording, every, model, truth)
    by_gap = {gap: residual(found, model, truth) for gap, found in pairs.items()}
    report = RobotReport(model, by_gap, focal, offset, truth)

    trials = list(_trials(recording, every, model, truth, focal, offset))
    after = np.array([residual(every, t.model, t.poses) for t in trials])
    front = _front(every, model, truth)
    limit = CLEAR_GAIN * now if front >= BEHIND else max(now, FINE_PX)
    for best in np.argsort(after, kind="stable").tolist():
        fault, remedy, changed, poses = trials[best]
        if after[best] >= limit:
            break
        ahead = _front(every, changed, poses)
        if ahead < BEHIND:
            continue
        told = f"the residual of Cs falls from {now:.2f} to {after[best]:.2f} px"
        if front < BEHIND:
            told = f"{100 * ahead:.0f} % of the points lie before the camera, not {100 * front:.0f} %"
        finding = f"{fault[0].upper()}{fault[1:]}: corrected, {told}; {remedy}."
        return RobotReport(changed, by_gap, focal, offset, poses, findings=[finding])
    if front < BEHIND:
        report.findings.append(
            f"Under the poses only {100 * front:.0f} % of the points lie before the camera, and no usual "
            "mistake explains it; check what axes the camera has (x right, y down, z forward)."
        )
    if now > FINE_PX:
        report.findings.append(
            f"The poses do not fit the images: the median residual is {now:.2f} px, and no usual mistake "
            "(focal length, size, mirroring, clock, axes, inverse, order of names or quaternions) explains "
            "it; check what the poses are of (T_WC: camera to world) and the distortion."
        )
    return report


def residual(pairs: list[Pair], model: MirroredCamera, poses: Array) -> float:
    """Median epipolar residual of pairs of Cs whose poses are known, px; infinite if there are none."""
    values = [
        epipolar_residuals(p.matches, model, model, pose_inverse(poses[p.i]) @ poses[p.j])
        for p in pairs
        if np.isfinite(poses[[p.i, p.j]]).all()
    ]
    return float(np.median(np.concatenate(values))) if values and sum(map(len, values)) else np.inf


def _front(pairs: list[Pair], model: MirroredCamera, poses: Array) -> float:
    """Share of the points of pairs of Cs that lie in front of both of its places; 1 if nothing tells it."""
    known = [p for p in pairs if np.isfinite(poses[[p.i, p.j]]).all()]
    return share_in_front(
        [in_front(p.matches, model, model, pose_inverse(poses[p.i]) @ poses[p.j]) for p in known]
    )


def _offset(recording: Recording, pairs: list[Pair], model: MirroredCamera, truth: Array) -> float:
    between = float(np.median(np.diff(recording.times)))
    reach = max(CLOCK, 3.0 * between)
    shifts = np.linspace(-reach, reach, 25)
    return least(lambda s: residual(pairs, model, _shifted(recording, truth, s)), shifts, 0.0)


def _shifted(recording: Recording, truth: Array, shift: float) -> Array:
    known = np.isfinite(truth).all(axis=(1, 2))
    return interpolate_track(recording.times[known], truth[known], recording.times + shift)


def _trials(
    recording: Recording, pairs: list[Pair], model: MirroredCamera, truth: Array, focal: float, offset: float
) -> Iterator[_Trial]:
    """Cs with each usual mistake undone."""
    if abs(focal - 1.0) > FOCAL_TOLERANCE:
        yield _Trial(
            f"the focal length of Cs does not fit, {focal:.2f} times the calibrated one does",
            "calibrate this camera at this resolution",
            model.with_focal(focal),
            truth,
        )
    if abs(offset) > OFFSET_TOLERANCE * float(np.median(np.diff(recording.times))):
        yield _Trial(
            f"the time stamps of Cs do not fit the poses, with {offset:+.3f} s added to the images' they do",
            "correct the clocks, or shift the stamps (--times)",
            model,
            _shifted(recording, truth, offset),
        )
    for size in SIZES:
        yield _Trial(
            f"the images of Cs were scaled after the calibration, by {size:.2f}",
            "scale focal lengths and centre in the calibration alike",
            model.scaled(float(size)),
            truth,
        )
    for mirror in MIRRORS:
        yield _Trial(mirror.fault.format(camera="Cs"), mirror.remedy, mirror.undo(model), truth)
    order = sorted(range(len(truth)), key=str)
    if order != list(range(len(truth))):
        ranks = np.argsort(order)
        for of, remedy, poses in (
            ("images", "number them with leading zeros", truth[order]),
            ("poses", "write them in the order of the images", truth[ranks]),
        ):
            fault = f"the {of} are in the order of names as text (0, 1, 10, 11, 2)"
            yield _Trial(fault, remedy, model, poses)
    for mistake in (*TRUE_POSE_MISTAKES, *body_mistakes(getattr(recording, "t_bs", None))):
        poses = np.array([mistake.undo(t) if np.isfinite(t).all() else t for t in truth])
        yield _Trial(mistake.fault, mistake.remedy, model, poses)


def _pairs(recording: Recording, truth: Array, gap: int, points: dict[int, Points]) -> list[Pair]:
    """Pairs of frames a gap apart, spread over the recording, that moved and share points."""
    known = np.asarray(np.isfinite(truth).all(axis=(1, 2)))
    moved = [
        i
        for i in range(len(recording) - gap)
        if known[i] and known[i + gap]
        and float(np.linalg.norm(truth[i + gap, :3, 3] - truth[i, :3, 3])) >= LEAST_BASELINE
    ]  # fmt: skip
    pairs = []
    for i in spread(moved, PAIRS_PER_GAP):
        for k in (i, i + gap):
            if k not in points:
                points[k] = describe(recording.image(k))
        pairs.append(Pair(i, i + gap, match_points(points[i], points[i + gap])))
    return [p for p in pairs if len(p.matches.uv_a) >= LEAST_MATCHES]

"""Do the calibration, the poses and the time stamps of a recording agree with its images?

Matched points of two frames must lie on each other's epipolar lines under the poses given.  The residual by
frame gap shows calibration (all gaps) and drifting poses (growing with the gap); trials with another focal
length and with shifted stamps tell which of them is off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from collabslam.checks.matching import LEAST_MATCHES, Matches, epipolar_residuals, match_images
from collabslam.checks.trials import CLEAR_GAIN, OFFSET_TOLERANCE, least, spread
from collabslam.checks.worn import WornReport, check_worn
from collabslam.datasets.poses import interpolate_track
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Recording

GAPS = (1, 2, 5, 10, 20)
PAIRS_PER_GAP = 6
LEAST_BASELINE = 0.01
FINE_PX = 1.5
"""Largest median residual at which poses and calibration count as fitting the images."""
FOCAL_TOLERANCE = 0.02


@dataclass(frozen=True)
class CalibrationReport:
    """What was found; residuals are medians, pixels.

    Attributes
    ----------
    by_gap : dict of frame gap to residual of Cs under the true poses
    focal : float or None
        Factor on the focal lengths that fits best.
    offset : float or None
        Seconds to add to the image stamps of Cs so that the poses fit best.
    worn : WornReport
        What the views of Cf say of ``T_CF``.
    findings : list of str
        What is wrong, in sentences.
    notes : list of str
        What could not be checked, in sentences.
    """

    by_gap: dict[int, float] = field(default_factory=dict)
    focal: float | None = None
    offset: float | None = None
    worn: WornReport = field(default_factory=WornReport)
    findings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def check_calibration(recording: Recording) -> CalibrationReport:
    """Check a recording; nothing of it is changed.

    Parameters
    ----------
    recording : Recording
        With true poses, recorded worn views, or both: without either there is nothing to compare with.
    """
    findings: list[str] = []
    notes: list[str] = []
    by_gap, focal, offset = _check_poses(recording, findings, notes)
    worn = check_worn(recording)
    return CalibrationReport(by_gap, focal, offset, worn, findings + worn.findings, notes + worn.notes)


@dataclass(frozen=True)
class _Pair:
    i: int
    j: int
    matches: Matches


def _check_poses(
    recording: Recording, findings: list[str], notes: list[str]
) -> tuple[dict[int, float], float | None, float | None]:
    truth = recording.truth
    if truth is None:
        notes.append("There are no true poses (--poses): calibration and stamps of Cs are not checked.")
        return {}, None, None
    pairs = {gap: _pairs(recording, truth, gap) for gap in GAPS}
    pairs = {gap: found for gap, found in pairs.items() if found}
    if not pairs:
        notes.append(
            f"No two frames with poses are {100 * LEAST_BASELINE:.0f} cm apart and share {LEAST_MATCHES} "
            "points: calibration and stamps of Cs are not checked."
        )
        return {}, None, None

    def residual(chosen: Sequence[_Pair], poses: Array, focal: float = 1.0) -> float:
        camera = recording.camera
        values = [
            epipolar_residuals(p.matches, camera, camera, pose_inverse(poses[p.i]) @ poses[p.j], focal)
            for p in chosen
            if np.isfinite(poses[[p.i, p.j]]).all()
        ]
        return float(np.median(np.concatenate(values))) if values else np.inf

    by_gap = {gap: residual(found, truth) for gap, found in pairs.items()}
    every = [p for found in pairs.values() for p in found]
    now = residual(every, truth)
    focal = least(lambda f: residual(every, truth, f), np.linspace(0.8, 1.25, 19), 1.0)
    between = float(np.median(np.diff(recording.times)))
    shifts = np.linspace(-3.0, 3.0, 25) * between
    track = recording.times, truth
    offset = least(lambda s: residual(every, interpolate_track(*track, recording.times + s)), shifts, 0.0)
    shifted = interpolate_track(*track, recording.times + offset)
    with_focal, with_offset = residual(every, truth, focal), residual(every, shifted)
    if abs(focal - 1.0) > FOCAL_TOLERANCE and with_focal < CLEAR_GAIN * now and with_focal <= with_offset:
        findings.append(
            f"The focal length does not fit: with {focal:.2f} times the calibrated one the residual falls "
            f"from {now:.2f} to {with_focal:.2f} px; calibrate this camera at this resolution."
        )
    elif abs(offset) > OFFSET_TOLERANCE * between and with_offset < CLEAR_GAIN * now:
        findings.append(
            f"The time stamps do not fit the poses: with {offset:+.3f} s added to the images' stamps the "
            f"residual falls from {now:.2f} to {with_offset:.2f} px; correct the clocks, or shift the stamps "
            "(--times)."
        )
    elif now > FINE_PX:
        findings.append(
            f"The poses do not fit the images: the median residual is {now:.2f} px, and neither another "
            "focal length nor another time offset explains it; check what the poses are of (T_WC: camera to "
            "world) and the distortion."
        )
    return by_gap, focal, offset


def _pairs(recording: Recording, truth: Array, gap: int) -> list[_Pair]:
    """Pairs of frames a gap apart, spread over the recording, that moved and share points."""
    known = np.asarray(np.isfinite(truth).all(axis=(1, 2)))
    near = range(len(recording) - gap)
    moved = [
        i
        for i in near
        if known[i] and known[i + gap]
        and float(np.linalg.norm(truth[i + gap, :3, 3] - truth[i, :3, 3])) >= LEAST_BASELINE
    ]  # fmt: skip
    chosen = spread(moved, PAIRS_PER_GAP)
    pairs = [_Pair(i, i + gap, match_images(recording.image(i), recording.image(i + gap))) for i in chosen]
    return [p for p in pairs if len(p.matches.uv_a) >= LEAST_MATCHES]

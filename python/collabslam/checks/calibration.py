"""Do the calibration, the poses and the time stamps of a recording agree with its images?

Matched points of two frames must lie on each other's epipolar lines under the poses given.  The residual by
frame gap shows calibration (all gaps) and drifting poses (growing with the gap); trials with another focal
length and with shifted stamps tell which of them is off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from collabslam._core import Camera
from collabslam.checks.matching import Matches, epipolar_residuals, match_images
from collabslam.datasets.poses import interpolate_track
from collabslam.frontend.epipolar import find_consensus
from collabslam.geometry import pose_inverse, se3_log
from collabslam.types import Array, Recording, WornView

GAPS = (1, 2, 5, 10, 20)
PAIRS_PER_GAP = 6
WORN_PAIRS = 12
LEAST_MATCHES = 20
LEAST_BASELINE = 0.01
FINE_PX = 1.5
"""Largest median residual at which poses and calibration count as fitting the images."""
FOCAL_TOLERANCE = 0.02
OFFSET_TOLERANCE = 0.25
"""Largest time offset that counts as none, as a share of the time between frames."""
WORN_SIGMAS = 2.5
"""Correction of T_CF in standard deviations (root mean square over its six numbers) that contradicts it."""
WIDE = 100.0
"""Factor on T_CF's covariance when the images are asked, so that they and not the prior answer."""
CLEAR_GAIN = 0.85
"""A trial is believed if it brings the residual below this share of the residual without it."""


class WornError(NamedTuple):
    """Correction of ``T_CF`` by the images: metres, degrees, and in standard deviations (1 is expected)."""

    metres: float
    degrees: float
    sigmas: float


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
    worn : float or None
        Residual of Cf's views under the measured ``T_CF``.
    worn_error : WornError or None
        How far the images correct ``T_CF``.
    findings : list of str
        What is wrong, in sentences.
    notes : list of str
        What could not be checked, in sentences.
    """

    by_gap: dict[int, float] = field(default_factory=dict)
    focal: float | None = None
    offset: float | None = None
    worn: float | None = None
    worn_error: WornError | None = None
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
    worn, error = _check_worn(recording, findings, notes)
    return CalibrationReport(by_gap, focal, offset, worn, error, findings, notes)


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
    focal = _best(lambda f: residual(every, truth, f), np.linspace(0.8, 1.25, 19), 1.0)
    between = float(np.median(np.diff(recording.times)))
    shifts = np.linspace(-3.0, 3.0, 25) * between
    track = recording.times, truth
    offset = _best(lambda s: residual(every, interpolate_track(*track, recording.times + s)), shifts, 0.0)
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
    chosen = _spread(moved, PAIRS_PER_GAP)
    pairs = [_Pair(i, i + gap, match_images(recording.image(i), recording.image(i + gap))) for i in chosen]
    return [p for p in pairs if len(p.matches.uv_a) >= LEAST_MATCHES]


def _check_worn(
    recording: Recording, findings: list[str], notes: list[str]
) -> tuple[float | None, WornError | None]:
    """Residual under ``T_CF``, and by how much the images contradict it, medians over some views."""
    camera = recording.worn_camera
    if camera is None:
        return None, None
    residuals: list[float] = []
    errors: list[tuple[float, float, float]] = []
    for i in _spread(range(len(recording)), 4 * WORN_PAIRS):
        frame = recording.frame(i)
        if frame.worn is None or len(residuals) == WORN_PAIRS:
            continue
        matches = match_images(frame.image, frame.worn.image)
        if len(matches.uv_a) < LEAST_MATCHES:
            continue
        found = epipolar_residuals(matches, recording.camera, camera, frame.worn.t_cf)
        residuals.append(float(np.median(found)))
        errors.append(_worn_error(matches, recording.camera, camera, frame.worn))
    if not residuals:
        notes.append(
            f"No view of Cf shares {LEAST_MATCHES} points with Cs: its calibration and T_CF are not checked."
        )
        return None, None
    error = WornError(*(float(v) for v in np.median(errors, axis=0)))
    if error.sigmas > WORN_SIGMAS:
        findings.append(
            f"The measured pose of Cf contradicts the images: they move it by {100 * error.metres:.1f} cm "
            f"and {error.degrees:.1f} degrees, {error.sigmas:.1f} times what its covariance allows; check "
            "that T_CF maps from Cf to Cs, its clock, and its covariance."
        )
    return float(np.median(residuals)), error


def _worn_error(
    matches: Matches, camera: Camera, worn_camera: Camera, view: WornView
) -> tuple[float, float, float]:
    """Metres and degrees by which the images correct ``T_CF``, and that in standard deviations."""
    rays = [c.unproject(uv) for c, uv in ((camera, matches.uv_a), (worn_camera, matches.uv_b))]
    usable = np.all([np.isfinite(r).all(axis=1) for r in rays], axis=0)
    focal = tuple(float(np.sqrt(c.intrinsics[0] * c.intrinsics[1])) for c in (camera, worn_camera))
    seen = find_consensus(
        rays[0][usable],
        rays[1][usable],
        view.t_cf,
        WIDE * view.covariance,
        (focal[0], focal[1]),
        1.0,
        3.0,
    )
    xi = se3_log(pose_inverse(view.t_cf) @ seen.t_cf)
    allowed = view.covariance + seen.covariance
    sigmas = float(np.sqrt(xi @ np.linalg.solve(allowed, xi) / 6.0))
    return float(np.linalg.norm(xi[:3])), float(np.degrees(np.linalg.norm(xi[3:]))), sigmas


def _spread(items: Sequence[int], count: int) -> list[int]:
    """At most ``count`` of the items, evenly."""
    if not items:
        return []
    return [int(items[k]) for k in np.unique(np.linspace(0, len(items) - 1, count).round().astype(int))]


def _best(cost: Callable[[float], float], grid: Array, default: float) -> float:
    """Where a cost is least: on the grid, then between its points by a parabola."""
    values = np.array([cost(float(x)) for x in grid])
    k = int(np.argmin(values))
    if not np.isfinite(values[k]):
        return default
    if 0 < k < len(grid) - 1 and np.isfinite(values[[k - 1, k + 1]]).all():
        left, middle, right = values[k - 1 : k + 2]
        bend = left - 2.0 * middle + right
        if bend > 0.0:
            return float(grid[k] + 0.5 * (left - right) / bend * (grid[1] - grid[0]))
    return float(grid[k])

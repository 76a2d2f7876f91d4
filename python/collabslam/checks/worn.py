"""Does the measured pose of the worn camera agree with the images?"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from collabslam._core import Camera, MatchNoise, find_consensus
from collabslam.checks.matching import LEAST_MATCHES, Matches, epipolar_residuals, match_images
from collabslam.checks.trials import CLEAR_GAIN, OFFSET_TOLERANCE, least, spread
from collabslam.datasets.poses import interpolate_track
from collabslam.geometry import pose_inverse, se3_log
from collabslam.types import Array, Recording, WornView

VIEWS = 12
WORN_SIGMAS = 2.5
"""Correction of T_CF in standard deviations (root mean square over its six numbers) that contradicts it."""
WIDE = 100.0
"""Factor on T_CF's covariance when the images are asked, so that they and not the prior answer."""
REACH = 2
"""Frames before and after a view between which T_CF is shifted in time."""


class WornError(NamedTuple):
    """Correction of ``T_CF`` by the images: metres, degrees, and in standard deviations (1 is expected)."""

    metres: float
    degrees: float
    sigmas: float


@dataclass(frozen=True)
class WornReport:
    """What the views of Cf say of ``T_CF``.

    Attributes
    ----------
    residual : float or None
        Median epipolar residual under the measured pose, pixels.
    error : WornError or None
        How far the images correct it, medians.
    offset : float or None
        Seconds to add to the stamps of Cf's images so that ``T_CF`` fits clearly better; None if none does.
        Less than half a frame is not seen.
    findings, notes : list of str
        What is wrong, and what could not be checked, in sentences.
    """

    residual: float | None = None
    error: WornError | None = None
    offset: float | None = None
    findings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


class _View(NamedTuple):
    """One view of Cf: its matches, its stamp, and the measured poses around it with theirs."""

    matches: Matches
    t: float
    times: Array
    poses: Array


def check_worn(recording: Recording) -> WornReport:
    """Hold ``T_CF`` against some of the views; nothing to say where there is no worn camera."""
    camera = recording.worn_camera
    if camera is None:
        return WornReport()
    views: list[_View] = []
    errors: list[tuple[float, float, float]] = []
    for i in spread(range(len(recording)), 4 * VIEWS):
        frame = recording.frame(i)
        if frame.worn is None or len(views) == VIEWS:
            continue
        matches = match_images(frame.image, frame.worn.image)
        if len(matches.uv_a) < LEAST_MATCHES:
            continue
        views.append(_View(matches, frame.t, *_track(recording, i)))
        errors.append(_worn_error(matches, recording.camera, camera, frame.worn))
    if not views:
        text = (
            f"No view of Cf shares {LEAST_MATCHES} points with Cs: its calibration and T_CF are not checked."
        )
        return WornReport(notes=[text])

    def residual(shift: float) -> float:
        poses = [interpolate_track(v.times, v.poses, np.array([v.t + shift]))[0] for v in views]
        if not np.isfinite(poses).all():
            return np.inf
        pairs = zip(views, poses, strict=True)
        found = [epipolar_residuals(v.matches, recording.camera, camera, t_cf) for v, t_cf in pairs]
        return float(np.median(np.concatenate(found)))

    now, between = residual(0.0), float(np.median(np.diff(recording.times)))
    # Whole frames only: between two of them the noise of T_CF averages out, which looks like a better fit.
    shifts: Array = np.linspace(-REACH, REACH, 2 * REACH + 1) * between
    shift, shifted = least(residual, shifts, 0.0), float(np.nanmin([residual(float(s)) for s in shifts]))
    error = WornError(*(float(v) for v in np.median(errors, axis=0)))
    findings, offset = [], None
    if abs(shift) > OFFSET_TOLERANCE * between and shifted < CLEAR_GAIN * now:
        offset = shift
        findings.append(
            f"The time stamps of Cf and of T_CF do not agree: with {shift:+.3f} s added to the images' "
            f"stamps the residual falls from {now:.2f} to {shifted:.2f} px; correct the clocks."
        )
    elif error.sigmas > WORN_SIGMAS:
        findings.append(
            f"The measured pose of Cf contradicts the images: they move it by {100 * error.metres:.1f} cm "
            f"and {error.degrees:.1f} degrees, {error.sigmas:.1f} times what its covariance allows; check "
            "that T_CF maps from Cf to Cs, its clock, and its covariance."
        )
    return WornReport(now, error, offset, findings)


def _track(recording: Recording, i: int) -> tuple[Array, Array]:
    """Stamps and measured ``T_CF`` of the frames around frame ``i`` without a gap."""
    found = []
    for k in range(max(0, i - REACH), min(len(recording), i + REACH + 1)):
        frame = recording.frame(k)
        if frame.worn is not None:
            found.append((frame.t, frame.worn.t_cf))
    return np.array([t for t, _ in found]), np.array([t_cf for _, t_cf in found])


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
        MatchNoise((focal[0], focal[1]), 1.0, 3.0),
    )
    xi = se3_log(pose_inverse(view.t_cf) @ seen.t_cf)
    allowed = view.covariance + seen.covariance
    sigmas = float(np.sqrt(xi @ np.linalg.solve(allowed, xi) / 6.0))
    return float(np.linalg.norm(xi[:3])), float(np.degrees(np.linalg.norm(xi[3:]))), sigmas

"""Does the measured pose of the worn camera agree with the images?

A trial (what is given, or what is given with one usual mistake undone) costs what is left when each view's
matches have corrected T_CF within its covariance, and that correction in standard deviations.  A trial is
believed where it costs so much less that errors of T_CF within its covariance would hardly ever do so; they
may be the same in all views of a stretch in which Cf is there, which then speak as one.  Whether T_CF is
contradicted at all is the test that a running filter makes too (`worn_verdict`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from collabslam import _core
from collabslam._core import MatchNoise, find_consensus
from collabslam.checks.matching import (
    BEHIND,
    LEAST_MATCHES,
    Matches,
    epipolar_residuals,
    in_front,
    share_in_front,
)
from collabslam.checks.mistakes import MirroredCamera, PoseMistake
from collabslam.checks.report import Report
from collabslam.checks.robot import RobotReport
from collabslam.checks.samples import spread
from collabslam.checks.trials import Trial, worn_trials
from collabslam.checks.views import VIEWS, View, sample_views
from collabslam.datasets.at_frames import AtFrames
from collabslam.datasets.printed_pose import PRINTED
from collabslam.frontend.worn_verdict import INDEPENDENT, LIMIT, SIGMA, Verdict, ask_images, contradicted
from collabslam.geometry import pose_inverse, se3_log
from collabslam.types import Array

MOST_PX = 4.0
"""Median residual above which Cf is never said to agree."""
CLEAR_COST = 12.0
"""A trial is believed if it costs so much less: one error of T_CF would have to be 3.5 standard deviations,
which among a dozen trials that differ happens in one of 200 recordings."""
_SURE = 3.0
_LIKELY = 16.8
"""Squared correction of T_CF in standard deviations that one of 100 right ones exceeds (six numbers)."""
_HALF_NORMAL = 0.6745
"""Median of the absolute value of a normal variable of unit standard deviation."""


class WornError(NamedTuple):
    """Correction of ``T_CF`` by the images: metres, degrees, and in standard deviations (1 is expected)."""

    metres: float
    degrees: float
    sigmas: float


@dataclass(frozen=True)
class WornReport(Report):
    """What the views of Cf say of ``T_CF``.

    Attributes
    ----------
    residual : float or None
        Median epipolar residual under the measured pose, pixels.
    expected : float or None
        The residual that its covariance leads one to expect, pixels.
    error : WornError or None
        How far the images correct it, medians.
    undo : PoseMistake or None
        The mistake in the poses of Cf that was found.
    """

    residual: float | None = None
    expected: float | None = None
    error: WornError | None = None
    undo: PoseMistake | None = None

    @property
    def agrees(self) -> bool:
        """Whether the images agree with ``T_CF``; not where they cannot say."""
        return self.residual is not None and not self.findings and self.residual <= MOST_PX


def check_worn(recording: AtFrames, robot: RobotReport) -> WornReport:
    """Hold ``T_CF`` against some of the views; nothing to say where there is no worn camera.

    Parameters
    ----------
    recording : AtFrames
    robot : RobotReport
        What was found of Cs: its camera is taken as mended there.
    """
    if recording.worn_camera is None:
        return WornReport()
    models = robot.model, MirroredCamera(recording.worn_camera)
    views = sample_views(recording)
    if not views:
        seen = any(recording.view(i) is not None for i in spread(range(len(recording)), 4 * VIEWS))
        what = f"No view of Cf shares {LEAST_MATCHES} points with Cs" if seen else "No view of Cf has a T_CF"
        if not seen and recording.worn_pose == PRINTED:
            what = "The printed target of T_CF was never seen by both cameras"
        text = f"{what}: its calibration and T_CF are not checked."
        return WornReport(notes=[text])
    given = Trial("", "", models)
    costs = _costs(views, given)
    now, expected = _residual(views, given), _expected(views, given)
    verdicts = [_asked(view, given) for view in views]
    error = _error(views, verdicts)
    between = float(np.median(np.diff(recording.times)))
    t_bs = recording.t_bs if recording.rig_used else None
    trials = list(worn_trials(models, views, between, robot, t_bs))
    tried, white = [_costs(views, t) for t in trials], _white_share(views, given)
    best = int(np.argmax([_gain(views, costs, cost, white) for cost in tried]))
    gain = _gain(views, costs, tried[best], min(white, _white_share(views, trials[best])))
    findings, undo, front = [], None, _front(views, given)
    if front < BEHIND and not gain > CLEAR_COST:
        ahead = [_front(views, t) if _explains(views, t) else 0.0 for t in trials]
        medians = [
            np.nanmedian(cost) if share >= BEHIND else np.inf
            for cost, share in zip(tried, ahead, strict=True)
        ]
        best = int(np.argmin(medians))
        undo = trials[best].mistake
        findings.append(
            f"Under T_CF only {100 * front:.0f} % of the points lie in front of both cameras"
            + (
                f": {trials[best].fault}; {trials[best].remedy}, and {100 * ahead[best]:.0f} % do."
                if np.isfinite(medians[best])
                else ", and no usual mistake explains it; check how T_CF was measured."
            )
        )
    elif gain > CLEAR_COST and _explains(views, trials[best]) and _front(views, trials[best]) >= BEHIND:
        fault, undo = trials[best].fault, trials[best].mistake
        findings.append(
            f"{fault[0].upper()}{fault[1:]}: corrected, {_falls(views, given, trials[best])}; "
            f"{trials[best].remedy}."
        )
    elif error is not None and contradicted([np.nan if v is None else v.against for v in verdicts]):
        findings.append(
            f"The measured pose of Cf contradicts the images (residual {now:.2f} px): they move it by "
            f"{100 * error.metres:.1f} cm and {error.degrees:.1f} degrees, {error.sigmas:.1f} times what its "
            "covariance allows, and no usual mistake explains it; check how T_CF was measured, and its "
            "covariance."
        )
    elif now > MOST_PX and now > 2.0 * expected:
        findings.append(
            f"The residual of Cf under T_CF is {now:.2f} px where its covariance leads to {expected:.2f}, "
            "and no usual mistake explains it; check the calibration of both cameras."
        )
    notes = []
    if not findings and now > MOST_PX:
        notes.append(
            f"The residual of Cf is {now:.2f} px where the covariance of T_CF leads to {expected:.2f}: "
            "nothing contradicts T_CF, but the images cannot confirm it more finely than that."
        )
    return WornReport(now, expected, error, undo, findings=findings, notes=notes)


def _fits(view: View, trial: Trial) -> bool:
    """Whether the view has what a trial needs."""
    return trial.pose in view.poses and len(view.matches.get(trial.image, _NONE).uv_a) >= LEAST_MATCHES


_NONE = Matches(np.empty((0, 2)), np.empty((0, 2)))


def _costs(views: list[View], trial: Trial) -> Array:
    """Cost of a trial in each view; NaN where the view lacks what it needs."""
    return np.array([_corrected(v, trial)[0] if _fits(v, trial) else np.nan for v in views])


def _gain(views: list[View], given: Array, tried: Array, white: float) -> float:
    """How much less a trial costs than what is given, over the views that have both; 0 if it is not sure.

    What the median view gains counts once for each block where the errors of T_CF are the same throughout one
    (``white`` is 0), and once for each view where they are independent (1).  It is sure if the mean gain is
    above three of its standard errors: trials that take other measured poses bring their noise with them.
    """
    both = np.isfinite(given) & np.isfinite(tried)
    if both.sum() < min(3, len(given)):
        return 0.0
    blocks, less = np.array([v.block for v in views])[both], (given - tried)[both]
    clipped = np.clip(less, -CLEAR_COST, CLEAR_COST)
    error = float(np.std(clipped, ddof=1) / np.sqrt(len(clipped))) if len(clipped) > 1 else 0.0
    if np.mean(clipped) <= _SURE * error:
        return 0.0
    parts = [less[blocks == b] for b in np.unique(blocks)]
    return float(sum((1.0 + white * (len(part) - 1)) * np.median(part) for part in parts))


def _white_share(views: list[View], trial: Trial) -> float:
    """Share of T_CF's variance by which its errors differ within a block, as the images correct them."""
    scatter = expected = 0.0
    found = [(v, _asked(v, trial)) for v in views if _fits(v, trial)]
    asked = [(v, verdict) for v, verdict in found if verdict is not None]
    for block in {v.block for v, _ in asked}:
        members = [(v, verdict) for v, verdict in asked if v.block == block]
        if len(members) < 2:
            continue
        middle = np.median([verdict.correction for _, verdict in members], axis=0)
        for view, verdict in members:
            xi, told = verdict.correction, verdict.told
            weight = np.linalg.inv(view.covariance + told)
            fewer = 1.0 - 1.0 / len(members)
            scatter += float((xi - middle) @ weight @ (xi - middle) - fewer * np.trace(weight @ told))
            expected += fewer * float(np.trace(weight @ view.covariance))
    return float(np.clip(scatter / expected, 0.0, 1.0)) if expected > 0.0 else 0.0


def _explains(views: list[View], trial: Trial) -> bool:
    """Whether most matches of the median view agree with T_CF under a trial, corrected as it may be."""
    found = [_corrected(v, trial) for v in views if _fits(v, trial)]
    _, moved, agree = np.median(found, axis=0)
    return bool(moved < _LIKELY and agree > 0.5)


def _corrected(view: View, trial: Trial) -> tuple[float, float, float]:
    """Cost of a view, T_CF's correction in squared standard deviations, the share of matches that then agree.

    The covariance is taken alike along all axes: which axes they are may be what is wrong.
    """
    t_cf = trial.t_cf(view)
    sizes = [float(np.trace(view.covariance[k : k + 3, k : k + 3])) / 3.0 for k in (0, 3)]
    covariance = np.diag(np.repeat(np.maximum(sizes, 1e-12), 3))
    matches = view.matches[trial.image]
    rays = _usable(matches, trial.models)
    if len(rays[0]) < LEAST_MATCHES // 2:
        return np.inf, np.inf, 0.0
    focal = (trial.models[0].focal, trial.models[1].focal)
    seen = find_consensus(*rays, t_cf, covariance, MatchNoise(focal, SIGMA, LIMIT))
    left = epipolar_residuals(matches, *trial.models, seen.t_cf)
    xi = se3_log(pose_inverse(t_cf) @ seen.t_cf)
    moved = float(xi @ np.linalg.solve(covariance, xi))
    cost = INDEPENDENT * float(np.mean(np.minimum(left, LIMIT) ** 2)) + moved
    return cost, moved, float(np.mean(left < LIMIT))


def _falls(views: list[View], given: Trial, trial: Trial) -> str:
    """By how much the residual falls: as it is measured, or what T_CF's covariance cannot explain of it."""
    before, after = _residual(views, given), _residual(views, trial)
    where = "of Cf"
    if after >= before:
        where = "of Cf beyond T_CF's covariance"
        before, after = (float(np.sqrt(np.nanmedian(_costs(views, t)) / INDEPENDENT)) for t in (given, trial))
    return f"the residual {where} falls from {before:.2f} to {after:.2f} px"


def _residual(views: list[View], trial: Trial) -> float:
    found = [
        epipolar_residuals(v.matches[trial.image], *trial.models, trial.t_cf(v))
        for v in views
        if _fits(v, trial)
    ]
    return float(np.median(np.concatenate(found)))


def _front(views: list[View], trial: Trial) -> float:
    """Share of the points of views that lie in front of both cameras under a trial."""
    return share_in_front(
        [in_front(v.matches[trial.image], *trial.models, trial.t_cf(v)) for v in views if _fits(v, trial)]
    )


def _expected(views: list[View], trial: Trial) -> float:
    """Median residual that the covariance of T_CF and a pixel's own leave, px."""
    sizes = []
    focal = (trial.models[0].focal, trial.models[1].focal)
    for view in views:
        rays = _usable(view.matches[0], trial.models)
        jacobian = _core.epipolar_residuals(*rays, trial.t_cf(view), focal).jacobian
        sizes.append(np.einsum("ni,ij,nj->n", jacobian, view.covariance, jacobian))
    return float(_HALF_NORMAL * np.median(np.sqrt(np.concatenate(sizes) + SIGMA**2)))


def _usable(matches: Matches, models: tuple[MirroredCamera, MirroredCamera]) -> tuple[Array, Array]:
    """Unit rays of the matches that have one in both cameras."""
    rays = [model.rays(uv) for model, uv in zip(models, matches, strict=True)]
    usable = np.all([np.isfinite(r).all(axis=1) for r in rays], axis=0)
    a, b = (r[usable] / np.linalg.norm(r[usable], axis=1, keepdims=True) for r in rays)
    return a, b


def _asked(view: View, trial: Trial) -> Verdict | None:
    """What the images of a view say of T_CF under a trial."""
    models = trial.models
    rays = _usable(view.matches[trial.image], models)
    return ask_images(*rays, trial.t_cf(view), view.covariance, (models[0].focal, models[1].focal))


def _error(views: list[View], verdicts: list[Verdict | None]) -> WornError | None:
    """By how much the images correct ``T_CF``: medians over the views that say it."""
    rows = []
    for view, verdict in zip(views, verdicts, strict=True):
        if verdict is not None:
            xi, allowed = verdict.correction, view.covariance + verdict.told
            sigmas = np.sqrt(xi @ np.linalg.solve(allowed, xi) / 6.0)
            rows.append((np.linalg.norm(xi[:3]), np.degrees(np.linalg.norm(xi[3:])), sigmas))
    return WornError(*(float(v) for v in np.median(rows, axis=0))) if rows else None

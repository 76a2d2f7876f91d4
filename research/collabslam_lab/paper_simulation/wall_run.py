"""One estimator over a batch of runs of the 2-DoF simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from collabslam.evaluation.consistency import nees
from collabslam.types import Array
from collabslam_lab.paper_simulation.case import Case
from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings
from collabslam_lab.paper_simulation.wall import WallRuns, simulate
from collabslam_lab.paper_simulation.wall_filter import EMPTY, FEATURE, WAITING, WallFilter

_Kind = TypeVar("_Kind", np.bool_, np.float64)

COLLABORATIONS = ("mono", "independent", "shared")
"""No pseudo-stereo; with errors of their own for each measurement; with one error for a whole window."""


@dataclass(frozen=True)
class RunOutcome:
    """What B runs gave, frame by frame.

    A run that has diverged is NaN from then on.

    Attributes
    ----------
    error : (B, T) array
        Of the camera's position, metres.
    nees : (B, T) array
        Of the position, 2 degrees of freedom; NaN in the first frame, where it is known.
    scale_drift : (B, T) array
        s of Eq. 14; NaN where no feature in view has converged.
    path : (B, T, 2) array
        Estimated positions.
    position_covariance : (B, T, 2, 2) array
    map : (B, L, 2) array
        Last estimate of each landmark, NaN for those never in the map.
    """

    error: Array
    nees: Array
    scale_drift: Array
    path: Array
    position_covariance: Array
    map: Array


def run_wall(s: SimulationSettings, case: Case, seed: int, runs: Sequence[int]) -> RunOutcome:
    """Runs by number, with or without pseudo-stereo (`COLLABORATIONS`).

    The truth, the bearings and the unit draws of the pseudo-stereo noise are the same for every estimator,
    collaboration and ``range_sigma``.
    """
    data = simulate(s, seed, runs)
    sigma_r = s.range_sigma if case.range_sigma is None else case.range_sigma
    sigmas = [s.start_velocity_sigma, s.start_velocity_sigma, np.radians(s.start_turn_sigma)]
    f = WallFilter(s, case.estimator, data.states[:, 0, 3:] + data.start_draws * sigmas)
    records = []
    points = np.full(data.landmarks.shape, np.nan)
    for k in range(s.frames):
        if k == 0:
            _know(f, data)
            stereo = None
        else:
            f.predict()
            stereo = None
            if case.collaboration != "mono" and s.window_at(k) >= 0:
                stereo = data.stereo(s, k, shared=case.collaboration == "shared", range_sigma=sigma_r)
            visible = (f.kind > EMPTY) & _of_slots(f, data.visible[:, k])
            measured = (_of_slots(f, stereo[0]), _of_slots(f, stereo[1]), sigma_r) if stereo else None
            f.update(visible, _of_slots(f, data.bearings[:, k]), measured)
        _births(f, data, k, None if stereo is None else stereo[0], sigma_r)
        alive = np.where(f.alive, 1.0, np.nan)[:, None]
        records.append((f.x[:, :2] * alive, f.p[:, :2, :2].copy(), _scale_drift(f, data, k)))
        kept = f.kind == FEATURE
        points[np.nonzero(kept)[0], f.landmark[kept]] = f.points()[kept]
    path, covariance, drift = (np.stack(part, axis=1) for part in zip(*records, strict=True))
    off = path - data.states[:, :, :2]
    ratio = nees(off.reshape(-1, 2), covariance.reshape(-1, 2, 2)).reshape(off.shape[:2])
    ratio[:, 0] = np.nan
    return RunOutcome(np.hypot(off[..., 0], off[..., 1]), ratio, drift, path, covariance, points)


def _of_slots(f: WallFilter, values: NDArray[_Kind]) -> NDArray[_Kind]:
    """Values by landmark (B, L) as values by slot (B, K); those of empty slots mean nothing."""
    which = np.clip(f.landmark, 0, values.shape[1] - 1)
    return np.take_along_axis(values, which, 1)


def _know(f: WallFilter, data: WallRuns) -> None:
    aside = np.where(data.visible[:, 0], np.abs(data.true_bearings[:, 0]), np.inf)
    nearest = np.argsort(aside, axis=1)[:, : f.s.known_features]
    run = np.arange(f.count)
    for landmark in nearest.T:
        points = data.landmarks[run, landmark] + f.s.known_sigma * data.known_draws[run, landmark]
        f.know(run, landmark, points)


def _births(f: WallFilter, data: WallRuns, k: int, ranges: Array | None, sigma_r: float) -> None:
    """Delayed births where the parallax suffices, instant ones where there is a range, first sights
    elsewhere."""
    bearings, run = data.bearings[:, k], np.arange(f.count)
    waiting = (f.kind == WAITING) & _of_slots(f, data.visible[:, k])
    if ranges is None:
        waiting &= f.parallax(_of_slots(f, bearings)) > np.radians(f.s.min_parallax)
    for slot in np.flatnonzero(waiting.any(axis=0)):
        who = run[waiting[:, slot]]
        landmark = f.landmark[who, slot]
        if ranges is None:
            f.birth(who, landmark, bearings[who, landmark])
        else:
            f.birth_at_range(who, landmark, bearings[who, landmark], ranges[who, landmark], sigma_r)
    numbers = np.arange(data.visible.shape[2])
    new = data.visible[:, k] & (f.landmark[:, numbers % f.slots] < numbers)
    for landmark in np.flatnonzero(new.any(axis=0)):
        who = run[new[:, landmark]]
        which = np.full(len(who), landmark)
        if ranges is None:
            f.first_sight(who, which, bearings[who, which])
        else:
            f.birth_at_range(who, which, bearings[who, which], ranges[who, which], sigma_r)


def _scale_drift(f: WallFilter, data: WallRuns, k: int) -> Array:
    """(B,) s of Eq. 14 over converged features in view."""
    use = (f.rho_ratio() < f.s.converged) & (f.kind != EMPTY) & _of_slots(f, data.visible[:, k])
    away = f.points() - f.x[:, None, :2]
    ratio = np.where(use, _of_slots(f, data.true_ranges[:, k]) / np.hypot(away[..., 0], away[..., 1]), 0.0)
    count = use.sum(axis=1)
    drift: Array = np.where(count > 0, np.abs(1.0 - ratio.sum(axis=1) / np.maximum(count, 1)), np.nan)
    return drift

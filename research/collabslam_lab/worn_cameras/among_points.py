"""The real filter core among simulated points, with one worn camera or several: is its covariance consistent?

A camera travels along a wall of points as in the check of consistency of the paper's simulation.  Up to three
persons stand around it, each with a Cf that is turned its own way.  Their errors of T_CF are half white and
half time-correlated, each person's own or, where one tracker locates all of them, partly common; they, motion
and pixels are exactly what the filter assumes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from collabslam._core import Camera
from collabslam.batch.processes import use_one_thread
from collabslam.evaluation.consistency import nees, pose_tangent_error
from collabslam.geometry import rotation_exp, se3_exp
from collabslam.types import Array, Mask
from collabslam_lab.paper_simulation.cloud import SIZE, WORN_SIGMA, pixels, walk, wall
from collabslam_lab.paper_simulation.core_run import CoreRun, SimulatedFrame, SimulatedView, common_settings
from collabslam_lab.paper_simulation.estimators import Estimator
from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings

SETTINGS = {"duration": 6.0, "path": 3.0, "bearing_sigma": 0.1, "min_parallax": 1.0}
EVERY = 3
"""Frames from one view of each Cf to the next."""
PLACES = ((-0.6, -0.3, 0.0), (0.7, -0.4, 0.2), (-0.1, -0.6, -0.7))
"""Of the Cf in C, metres."""
TURNS = (0.0, -8.0, 6.0)
"""About the axis y of C, degrees."""
TIME_CORRELATED, LASTS = 0.5, 5.0
"""Share of the variance of T_CF that lasts, and how long, seconds."""
COMMON = 0.7
"""Share of it that is common to all where one tracker locates them."""
IN_VIEW = 20
DEFAULT = Estimator("default", "the filter as it is", gauge=True)


@dataclass(frozen=True)
class Told:
    """A run by frames (T,); NaN before the start and where there is none.

    Attributes
    ----------
    pose, position : array
        NEES of Cs's pose (6 degrees of freedom) and of its position (3).
    worn : array
        NEES of the poses of the worn cameras (6), the mean of those that were measured.
    error : array
        Of the position, metres.
    """

    pose: Array
    position: Array
    worn: Array
    error: Array


@dataclass(frozen=True)
class Variant:
    """Persons, the share of their errors that is really common, and the share that the filter is told."""

    persons: int
    common: float
    told: float


def run_points(variant: Variant, seed: int, runs: Sequence[int]) -> list[Told]:
    """Runs by number; also the work of a child process.  All variants meet the same motion and points."""
    use_one_thread()
    return [_run(variant, (seed, run)) for run in runs]


def _run(variant: Variant, seed: tuple[int, int]) -> Told:
    s = SimulationSettings(SETTINGS)
    rng = np.random.default_rng(seed)
    focal = 0.5 * SIZE[0] / np.tan(0.5 * np.radians(s.fov))
    sigma = float(focal * np.radians(s.bearing_sigma))
    camera = Camera("pinhole", *SIZE, (focal, focal, 0.5 * SIZE[0], 0.5 * SIZE[1]))
    points, poses = wall(s, rng), walk(s, rng)
    settings = {
        **common_settings(s, DEFAULT, focal),
        "estimator.mode": "collab-tight",
        "pixel.sigma_cf": sigma,
        "process.start_angular_velocity_sd": 0.1,
        "map.max_features": 5 * IN_VIEW,
        "worn.bias_share": TIME_CORRELATED,
        "worn.bias_time": LASTS,
        "worn.common_share": variant.told,
    }
    core = CoreRun(camera, settings, IN_VIEW, variant.persons)
    errors = _Errors(variant, 1.0 / s.rate, rng)
    frames = len(poses)
    found = np.tile(np.eye(4), (frames, 1, 1))
    covariances = np.full((frames, 6, 6), np.nan)
    of_worn = np.full(frames, np.nan)
    for k, pose in enumerate(poses):
        in_c = (points - pose[:3, 3]) @ pose[:3, :3]
        uv, visible = pixels(camera, in_c, sigma * rng.normal(size=(len(points), 2)))
        xi = errors.next()
        views = [
            _view(camera, in_c, visible, who, xi[who], sigma * rng.normal(size=(len(points), 2)))
            for who in range(len(PLACES))
        ][: variant.persons]
        if k % EVERY:
            views = []
        frame = SimulatedFrame(k / s.rate, uv, visible, views)
        report = core.step(frame)
        if core.filter.started:
            found[k], covariances[k] = core.filter.pose, core.filter.pose_covariance
            placed = [(est, pose @ t_cf(who), cov) for who, (est, cov) in report.worn_poses.items()]
            if placed:
                est, true, cov = (np.array(part) for part in zip(*placed, strict=True))
                of_worn[k] = np.nanmean(nees(pose_tangent_error(est, true), cov))
    e = pose_tangent_error(found, poses)
    began = int(np.argmax(np.isfinite(covariances[:, 0, 0])))
    # The start pose is known by definition, and W would be another if it were not the first frame's.
    late = np.arange(frames) > began
    full = np.where(late, nees(e, covariances), np.nan)
    position = np.where(late, nees(e[:, :3], covariances[:, :3, :3]), np.nan)
    return Told(full, position, np.where(late, of_worn, np.nan), np.linalg.norm(e[:, :3], axis=1))


def t_cf(who: int) -> Array:
    """True T_CF (4, 4) of a person."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation_exp([0.0, np.radians(TURNS[who]), 0.0]), PLACES[who]
    return pose


def _view(camera: Camera, in_c: Array, visible: Mask, who: int, xi: Array, noise: Array) -> SimulatedView:
    true = t_cf(who)
    uv_f, visible_f = pixels(camera, (in_c - true[:3, 3]) @ true[:3, :3], noise)
    return true @ se3_exp(-xi), np.diag(np.square(WORN_SIGMA)), uv_f, visible & visible_f


class _Errors:
    """Errors of T_CF (3, 6) frame by frame, tangent on the right; all are drawn, whoever is there."""

    def __init__(self, variant: Variant, dt: float, rng: np.random.Generator) -> None:
        self._rng, self._kept = rng, float(np.exp(-dt / LASTS))
        self._shares = np.sqrt([variant.common, 1.0 - variant.common])
        self._time_correlated = self._rng.standard_normal((4, 6))
        self._first = True

    def next(self) -> Array:
        """The errors of the next frame."""
        fresh, white = self._rng.standard_normal((2, 4, 6))
        if not self._first:
            self._time_correlated = self._kept * self._time_correlated + np.sqrt(1.0 - self._kept**2) * fresh
        self._first = False
        return np.stack([self._of(who, white) for who in range(len(PLACES))])

    def _of(self, who: int, white: Array) -> Array:
        """Row 0 of each is common, along C's axes in standard deviations; the others are the persons' own."""
        back = t_cf(who)[:3, :3].T
        into_f = np.kron(np.eye(2), back)
        covariance = np.diag(np.square(WORN_SIGMA))
        total = np.zeros(6)
        for share, draws in ((TIME_CORRELATED, self._time_correlated), (1.0 - TIME_CORRELATED, white)):
            own, common = draws[1 + who], draws[0]
            # The symmetric root of the covariance along C's axes, turned into F's.
            root = np.sqrt(share * np.diag(covariance))
            along_c = into_f.T @ (root[:, None] * into_f)
            total += into_f @ along_c @ (self._shares[0] * common + self._shares[1] * own)
        return total

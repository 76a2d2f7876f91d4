"""Where the images of one view put Cf: two images of Cs on a known path, and one of Cf (METHOD section 26).

Points that both images of Cs show have a depth in the unit of the path; they tell the whole pose of Cf in
that unit.  Points without one tell its epipolar lines.  The depth of each is an unknown of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from collabslam._core import MatchNoise, find_consensus
from collabslam.frontend.worn_verdict import INDEPENDENT, LEAST_AGREEING, LIMIT, SIGMA, WIDE
from collabslam.geometry import pose_inverse, se3_exp, se3_log, skew
from collabslam.types import Array

_LOOSE = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
"""What holds a pose where matches do not: metres and radians."""
_STEPS = 12


class SeenPose(NamedTuple):
    """Where the images put Cf.

    Attributes
    ----------
    t_cf : (4, 4) float64
        Maps points of F into C; its length is in the unit of Cs's path.
    covariance : (6, 6) float64
        Of it, tangent on the right.
    told : (6, 6) float64
        The part of ``covariance`` that comes from pixels; the rest is of what they leave open.
    matches, with_depth : int
        That agree, and those of them with a depth.
    """

    t_cf: Array
    covariance: Array
    told: Array
    matches: int
    with_depth: int


class Triplets(NamedTuple):
    """Matches of Cs and Cf, with what a second image of Cs says of their depth.

    Attributes
    ----------
    rays_s, rays_f : (M, 3) float64
        With z = 1, in C and F.
    rho, rho_sd : (M,) float64
        Inverse depth along Cs's optical axis, one over the unit of the path; NaN where it is not known.
    """

    rays_s: Array
    rays_f: Array
    rho: Array
    rho_sd: Array


def inverse_depths(rays: Array, others: Array, t_ab: Array, focal: float) -> tuple[Array, Array]:
    """Inverse depths in a camera of points that another image of it shows, and their standard deviations.

    Parameters
    ----------
    rays, others : (M, 3) array
        With z = 1, in both images; NaN where the other one does not show the point.
    t_ab : (4, 4) array
        Maps points of the other camera into the first.
    focal : float
        Pixels per radian.

    Returns
    -------
    (M,) array, (M,) array
        NaN where the rays do not meet in front of both cameras within `LIMIT` pixels.
    """
    t_ba = pose_inverse(t_ab)
    turned, shift = rays @ t_ba[:3, :3].T, t_ba[:3, 3]
    with np.errstate(invalid="ignore", divide="ignore"):
        across = np.cross(others, shift)
        rho = -np.sum(np.cross(others, turned) * across, axis=1) / np.sum(across**2, axis=1)
        there = turned + rho[:, None] * shift
        seen = there[:, :2] / there[:, 2:]
        off = focal * np.linalg.norm(seen - others[:, :2], axis=1)
        by_rho = (shift[:2] - seen * shift[2]) / there[:, 2:]
        sd = np.sqrt(2.0) * SIGMA / focal / np.linalg.norm(by_rho, axis=1)
        good = (off < LIMIT) & (rho > 0.0) & (there[:, 2] > 0.0)
    return np.where(good, rho, np.nan), np.where(good, sd, np.nan)


def seen_pose(
    triplets: Triplets, measured: Array, covariance: Array, focal: tuple[float, float]
) -> SeenPose | None:
    """The pose of Cf that most matches of a view agree on; None where too few agree on any.

    Parameters
    ----------
    triplets : Triplets
    measured : (4, 4) array
        T_CF as measured: where the search begins.
    covariance : (6, 6) array
        Of it, tangent on the right; the matches are sought under a far wider one.
    focal : (float, float)
        Of Cs and Cf, pixels per radian.
    """
    unit_s, unit_f = (
        rays / np.linalg.norm(rays, axis=1, keepdims=True) for rays in (triplets.rays_s, triplets.rays_f)
    )
    found = find_consensus(unit_s, unit_f, measured, WIDE * covariance, MatchNoise(focal, SIGMA, LIMIT))
    agree = np.asarray(found.agree)
    if agree.sum() < LEAST_AGREEING:
        return None
    used = Triplets(*(part[agree] for part in triplets))
    problem = _Problem(used, focal[1])
    pose = found.t_cf
    loose = np.diag(_LOOSE**-2.0)
    for _ in range(_STEPS):
        information, gradient, _ = problem.at(pose)
        drawn = se3_log(pose_inverse(pose) @ measured)
        step = np.linalg.solve(information + loose, gradient + loose @ drawn)
        pose = pose @ se3_exp(step)
        if np.abs(step).max() < 1e-7:
            break
    information, _, weights = problem.at(pose)
    good = int(np.sum(weights > 0.5))
    if not np.isfinite(pose).all() or good < LEAST_AGREEING:
        return None
    left = np.asarray(np.linalg.inv(information + loose), np.float64)
    deep = int(np.sum(np.isfinite(used.rho) & (weights > 0.5)))
    return SeenPose(pose, left, left @ information @ left, good, deep)


class _Problem:
    """Pixels of Cf, and depths, as a function of T_CF: each point's inverse depth is its own unknown."""

    def __init__(self, triplets: Triplets, focal: float) -> None:
        self._rays, self._seen = triplets.rays_s, triplets.rays_f[:, :2]
        known = np.isfinite(triplets.rho)
        self._prior = np.where(known, triplets.rho, 0.0)
        self._held = np.where(known, triplets.rho_sd, np.inf) ** -2.0
        self._sd = SIGMA / focal

    def at(self, pose: Array) -> tuple[Array, Array, Array]:
        """Information (6, 6) about a small motion of the pose, gradient (6,), and weights (M,) of matches."""
        turn, t = pose[:3, :3], pose[:3, 3]
        far, shift = self._rays @ turn, -turn.T @ t
        rho = self._best_rho(far, shift)
        there = far + rho[:, None] * shift
        u = there[:, :2] / there[:, 2:]
        by_point = np.zeros((len(u), 2, 3))
        by_point[:, 0, 0] = by_point[:, 1, 1] = 1.0 / there[:, 2]
        by_point[:, :, 2] = -u / there[:, 2:]
        moved = np.zeros((len(u), 3, 6))
        moved[:, :, :3] = -rho[:, None, None] * np.eye(3)
        moved[:, :, 3:] = [skew(p) for p in there]
        by_pose, by_rho = by_point @ moved, by_point @ shift
        off, off_rho = self._seen - u, self._prior - rho
        # Out goes rho: what a match says of the pose is what is left when its depth may follow.
        white = self._sd**-2.0
        own = white * np.sum(by_rho**2, axis=1) + self._held
        cross = white * np.einsum("mi,mij->mj", by_rho, by_pose)
        right = white * np.sum(by_rho * off, axis=1) + self._held * off_rho
        square = white * np.sum(off**2, axis=1) + self._held * off_rho**2 - right**2 / own
        weights = np.minimum(1.0, LIMIT / np.sqrt(np.maximum(square, 1e-12)))
        weights = np.where((there[:, 2] > 0.0) & np.isfinite(square), weights, 0.0)
        share = min(1.0, INDEPENDENT / max(float(weights.sum()), 1.0))
        w = share * weights
        information = white * np.einsum("m,mij,mik->jk", w, by_pose, by_pose)
        information -= np.einsum("m,mj,mk->jk", w / own, cross, cross)
        gradient = white * np.einsum("m,mij,mi->j", w, by_pose, off) - (w * right / own) @ cross
        return 0.5 * (information + information.T), gradient, weights

    def _best_rho(self, far: Array, shift: Array) -> Array:
        """Where the inverse depth of each point explains its pixel in Cf and its own measurement best."""
        rays = np.column_stack([self._seen, np.ones(len(self._seen))])
        across = np.cross(rays, shift)
        rho = -np.sum(np.cross(rays, far) * across, axis=1) / np.maximum(np.sum(across**2, axis=1), 1e-12)
        rho = np.where(self._held > 0.0, self._prior, np.maximum(rho, 1e-4))
        for _ in range(3):
            there = far + rho[:, None] * shift
            u = there[:, :2] / there[:, 2:]
            by_rho = (shift[:2] - u * shift[2]) / there[:, 2:]
            white = self._sd**-2.0
            own = white * np.sum(by_rho**2, axis=1) + self._held
            right = white * np.sum(by_rho * (self._seen - u), axis=1) + self._held * (self._prior - rho)
            rho = np.maximum(rho + right / np.maximum(own, 1e-12), 1e-5)
        return np.asarray(rho)

"""Geometry of two views whose relative pose is measured with a covariance.

Rays are unit vectors, so that nothing here depends on a camera model.  ``t_cf`` maps points of F into C; its
error is over (translation, rotation), tangent on the right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam import _core
from collabslam.types import Array, Mask

_LEVI_CIVITA = -np.cross(np.eye(3)[:, None], np.eye(3)[None])  # skew(v)[i, j] = _LEVI_CIVITA[i, j] @ v


@dataclass(frozen=True)
class Consensus:
    """Pose that matches agree on.

    Attributes
    ----------
    t_cf : (4, 4) float64
    covariance : (6, 6) float64
        Of the pose, over (translation, rotation).
    agree : (M,) bool
        Matches whose residual is within the limit under the pose.
    """

    t_cf: Array
    covariance: Array
    agree: Mask


def inverse_ranges(rays_s: Array, rays_f: Array, t_cf: Array) -> Array:
    """Inverse distance from Cs (1/m) where the rays of each pair pass; negative behind the cameras.

    Parameters
    ----------
    rays_s, rays_f : (M, 3) float64
    t_cf : (4, 4) float64

    Returns
    -------
    (M,) float64
    """
    turned = rays_f @ t_cf[:3, :3].T
    normal = turned @ skews(t_cf[:3, 3:])[0].T
    along = np.einsum("ni,ni->n", _cross(rays_s, turned), normal)
    return np.asarray(along / np.maximum((normal**2).sum(axis=1), 1e-12))


def find_consensus(
    rays_s: Array,
    rays_f: Array,
    t_cf: Array,
    covariance: Array,
    focal: tuple[float, float],
    sigma: float,
    limit: float,
    start: Consensus | None = None,
) -> Consensus:
    """Correction of a measured pose that most pairs agree on, under the prior of its covariance.

    Sampled first (three pairs and the prior give a correction, linear in the residuals), then refined by
    Gauss-Newton steps with Tukey weights.

    Parameters
    ----------
    rays_s, rays_f : (M, 3) float64
        Matched unit rays in C and F; fewer than three leave the pose as it is.
    t_cf : (4, 4) float64
        Measured pose.
    covariance : (6, 6) float64
    focal : (float, float)
        Focal lengths of Cs and Cf, pixels.
    sigma : float
        Standard deviation of a right match's residual, pixels.
    limit : float
        Largest residual of a match that agrees, pixels.
    start : Consensus, optional
        An earlier one of nearly the same matches; it takes the place of the sampling.

    Returns
    -------
    Consensus
    """
    first = None if start is None else start.t_cf
    found = _core.find_consensus(rays_s, rays_f, t_cf, covariance, focal, sigma, limit, first)
    return Consensus(*found)


def skews(vectors: Array) -> Array:
    """(K, 3, 3) matrices of the cross product with the columns of a (3, K) array."""
    return np.asarray((_LEVI_CIVITA @ vectors).transpose(2, 0, 1))


def _cross(a: Array, b: Array) -> Array:
    """Row by row cross product of (N, 3) arrays."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]

"""Geometry of two views whose relative pose is measured with a covariance.

Rays are unit vectors, so that nothing here depends on a camera model.  ``t_cf`` maps points of F into C; its
error is over (translation, rotation), tangent on the right.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collabslam import _core
from collabslam.types import Array, Mask

Block = NDArray[np.float32]

_BLOCK = 32  # rows of pairs treated at once
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


class PairGeometry:
    """Quantities of all pairs of rays of two views, in blocks of rows that stay in the cache."""

    def __init__(self, rays_s: Array, rays_f: Array, t_cf: Array, forms: Array) -> None:
        rotation, t = t_cf[:3, :3], t_cf[:3, 3]
        turned = rays_f @ rotation.T
        self.rows = len(rays_s)
        cross = skews(t[:, None])[0]
        self.n_f = np.maximum(((turned @ cross.T) ** 2).sum(axis=1), 1e-9).astype(np.float32)
        self.n_s = np.maximum(((rays_s @ cross) ** 2).sum(axis=1), 1e-9).astype(np.float32)
        self._along_s = (rays_s @ t).astype(np.float32)
        self._along_f = (turned @ t).astype(np.float32)
        self._left = (rays_s @ np.concatenate([rotation[None], forms])).astype(np.float32)
        self._right = np.ascontiguousarray(rays_f.T, dtype=np.float32)

    def blocks(self) -> Iterator[tuple[slice, Block, Block, Block]]:
        """Rows, the pairs' inverse ranges from Cs and Cf (rows, M), their bilinear forms (K, rows, M)."""
        for begin in range(0, self.rows, _BLOCK):
            part = slice(begin, min(self.rows, begin + _BLOCK))
            products = self._left[:, part] @ self._right
            rho = (self._along_s[part, None] - products[0] * self._along_f) / self.n_f
            rho_f = (self._along_s[part, None] * products[0] - self._along_f) / self.n_s[part, None]
            yield part, rho, rho_f, products[1:]

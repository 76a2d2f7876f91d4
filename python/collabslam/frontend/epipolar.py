"""Geometry of two views whose relative pose is measured with a covariance.

Rays are unit vectors, so that nothing here depends on a camera model.  ``t_cf`` maps points of F into C; its
error is over (translation, rotation), tangent on the right.
"""

from __future__ import annotations

import numpy as np

from collabslam.types import Array

_LEVI_CIVITA = -np.cross(np.eye(3)[:, None], np.eye(3)[None])  # skew(v)[i, j] = _LEVI_CIVITA[i, j] @ v


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


def skews(vectors: Array) -> Array:
    """(K, 3, 3) matrices of the cross product with the columns of a (3, K) array."""
    return np.asarray((_LEVI_CIVITA @ vectors).transpose(2, 0, 1))


def _cross(a: Array, b: Array) -> Array:
    """Row by row cross product of (N, 3) arrays."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]

"""Geometry of two views whose relative pose is measured with a covariance.

Rays are unit vectors, so that nothing here depends on a camera model.  ``t_cf`` maps points of F into C; its
error is over (translation, rotation), tangent on the right.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collabslam.geometry import pose_inverse, se3_exp, se3_log
from collabslam.types import Array, Mask

Block = NDArray[np.float32]

_HYPOTHESES = 150  # consensus samples; at 50 % wrong matches one of them is clean with probability 1 - 2e-9
_SAMPLE = 3  # matches a sample: with the prior they fix the directions that matter
_ITERATIONS = 6
_CONVERGED = 5e-3  # step in standard deviations of the prior
_PRIOR_WEIGHT = 0.05  # of a hypothesis' distance from the prior, against one match
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


def epipolar_residuals(
    rays_s: Array, rays_f: Array, t_cf: Array, focal: tuple[float, float]
) -> tuple[Array, Array]:
    """Sampson residual of each pair, and its derivative by an error of the pose.

    Parameters
    ----------
    rays_s, rays_f : (M, 3) float64
        Unit rays in C and F.
    t_cf : (4, 4) float64
    focal : (float, float)
        Focal lengths of Cs and Cf, pixels per radian.

    Returns
    -------
    residual : (M,) float64
        In units of the pixel noise: its standard deviation is that of one pixel coordinate.
    jacobian : (M, 6) float64
        By (translation, rotation) on the right of ``t_cf``, pixels per metre and per radian.
    """
    rotation, t = t_cf[:3, :3], t_cf[:3, 3]
    turned = rays_f @ rotation.T
    cross = skews(t[:, None])[0]
    across_f, across_s = turned @ cross.T, rays_s @ cross
    value = np.einsum("ni,ni->n", rays_s, across_f)
    variance = _sampson_variance((across_f**2).sum(axis=1), (across_s**2).sum(axis=1), value, focal)
    jacobian = np.hstack([_cross(rays_f, rays_s @ rotation), _cross(rays_f, across_s @ rotation)])
    # The residual does not depend on the length of t: without this term a pose without baseline explains all.
    jacobian[:, :3] -= value[:, None] * (t @ rotation / max(float(t @ t), 1e-12))
    scale = 1.0 / np.sqrt(variance)
    return value * scale, jacobian * scale[:, None]


def _sampson_variance(n_f: Array, n_s: Array, value: Array, focal: tuple[float, float]) -> Array:
    """Variance of the epipolar constraint for one pixel of noise in both views."""
    square = value**2
    return np.maximum((n_f - square) / focal[0] ** 2 + (n_s - square) / focal[1] ** 2, 1e-18)


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
    count = len(rays_s)
    if count < _SAMPLE:
        return Consensus(t_cf, covariance, np.ones(count, dtype=np.bool_))
    root = np.linalg.cholesky(covariance)
    residual, jacobian = epipolar_residuals(rays_s, rays_f, t_cf, focal)
    white = jacobian @ root
    if start is None:
        correction = _sampled_correction(residual, white, sigma, limit)
    else:
        correction = np.linalg.solve(root, se3_log(pose_inverse(t_cf) @ start.t_cf))
    posterior = np.eye(6)
    for _ in range(_ITERATIONS):
        pose = t_cf @ se3_exp(root @ correction)
        residual, jacobian = epipolar_residuals(rays_s, rays_f, pose, focal)
        white = jacobian @ root
        weight = np.maximum(1.0 - (residual / (1.5 * limit)) ** 2, 0.0) ** 2 / sigma**2
        posterior = np.linalg.inv(np.eye(6) + (white * weight[:, None]).T @ white)
        step = posterior @ (correction + white.T @ (weight * residual))
        correction = correction - step
        if np.abs(step).max() < _CONVERGED:
            break
    pose = t_cf @ se3_exp(root @ correction)
    residual, jacobian = epipolar_residuals(rays_s, rays_f, pose, focal)
    corrected = root @ posterior @ root.T
    return Consensus(pose, 0.5 * (corrected + corrected.T), np.abs(residual) <= limit)


def _sampled_correction(residual: Array, white: Array, sigma: float, limit: float) -> Array:
    """Correction (6,), in standard deviations of the prior, under which most residuals are small."""
    count = len(residual)
    draws = np.random.Generator(np.random.PCG64(count)).random((_HYPOTHESES, count))
    sample = np.argpartition(draws, _SAMPLE - 1, axis=1)[:, :_SAMPLE]
    js, rs = white[sample], residual[sample]
    small = js @ js.transpose(0, 2, 1) + sigma**2 * np.eye(_SAMPLE)
    z = -np.einsum("hki,hk->hi", js, np.linalg.solve(small, rs[..., None])[..., 0])
    z = np.vstack([np.zeros((1, 6)), z])
    left = residual[None] + z @ white.T
    cost = np.minimum(left**2 / limit**2, 1.0).sum(axis=1) + _PRIOR_WEIGHT * (z**2).sum(axis=1)
    return np.asarray(z[int(np.argmin(cost))])


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

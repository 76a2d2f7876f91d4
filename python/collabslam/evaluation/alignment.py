"""Alignment of an estimated trajectory to the true one (Umeyama, TPAMI 1991)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from collabslam.errors import InputError
from collabslam.types import Array


@dataclass(frozen=True)
class Similarity:
    """The map ``x -> scale * rotation @ x + translation``.

    Attributes
    ----------
    rotation : (3, 3) float64
    translation : (3,) float64, metres
    scale : float
    """

    rotation: Array
    translation: Array
    scale: float

    def apply(self, points: ArrayLike) -> Array:
        """The (N, 3) points, metres, mapped."""
        mapped = self.scale * np.asarray(points, np.float64) @ self.rotation.T + self.translation
        return np.asarray(mapped)


def point_pair(estimate: ArrayLike, truth: ArrayLike) -> tuple[Array, Array]:
    """Two (N, 3) arrays of equal length, checked.

    Raises
    ------
    InputError
        If a shape is wrong, the lengths differ, or a number is not finite.
    """
    a, b = np.asarray(estimate, np.float64), np.asarray(truth, np.float64)
    if a.ndim != 2 or a.shape[1] != 3 or a.shape != b.shape or not len(a):
        raise InputError(
            f"Positions have the shapes {a.shape} and {b.shape}; give two arrays (N, 3) of one length."
        )
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise InputError("Positions hold values that are not finite; leave those frames out.")
    return a, b


def umeyama(estimate: ArrayLike, truth: ArrayLike, *, with_scale: bool) -> Similarity:
    """Least-squares map of the estimated onto the true positions.

    Parameters
    ----------
    estimate, truth : (N, 3) arrays
        Positions at the same times, metres.
    with_scale : bool
        True for Sim(3); False for SE(3), where the scale is 1.

    Returns
    -------
    Similarity
        Of estimate to truth.  Where all points lie on a line, the rotation about it is arbitrary.

    Raises
    ------
    InputError
        If the arrays do not fit, or the scale is wanted of an estimate that never moves.
    """
    source, target = point_pair(estimate, truth)
    mean_source, mean_target = source.mean(axis=0), target.mean(axis=0)
    a, b = source - mean_source, target - mean_target
    u, singular, vt = np.linalg.svd(b.T @ a / len(a))
    sign = np.array([1.0, 1.0, 1.0 if np.linalg.det(u) * np.linalg.det(vt) > 0.0 else -1.0])
    rotation = (u * sign) @ vt
    scale = 1.0
    if with_scale:
        variance = float((a**2).sum() / len(a))
        if variance <= 0.0:
            raise InputError("The estimated positions are all the same; no scale can be found from them.")
        scale = float(singular @ sign) / variance
    return Similarity(rotation, mean_target - scale * rotation @ mean_source, scale)

"""How far off a pose may be that says OK."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from collabslam.types import Array

SIGMAS = 5.0
"""Of the axis that is known worst; how often it holds is measured in docs/consistency.md."""


class Bound(NamedTuple):
    """A radius and an angle that the error of a pose stays below.

    Attributes
    ----------
    radius : float
        Of the position, metres.
    angle : float
        Of the attitude, radians.
    """

    radius: float
    angle: float


def bounds(covariances: Array) -> tuple[Array, Array]:
    """The radii and angles (`Bound`) of poses.

    Parameters
    ----------
    covariances : (N, 6, 6) array
        Over (translation, rotation), m^2 and rad^2; finite.

    Returns
    -------
    (N,) arrays
        `SIGMAS` standard deviations along the axis that is known worst; no angle is above pi.
    """
    worst = [np.linalg.eigvalsh(covariances[:, part, part])[:, -1] for part in (slice(3), slice(3, 6))]
    radius, angle = (SIGMAS * np.sqrt(np.maximum(variance, 0.0)) for variance in worst)
    return radius, np.minimum(angle, np.pi)

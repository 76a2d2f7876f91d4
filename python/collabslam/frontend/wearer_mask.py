"""Where the robot sees whoever wears Cf: a person who walks is not a landmark (T_CF says where they are)."""

from __future__ import annotations

import numpy as np

from collabslam._core import Camera
from collabslam.types import Array, Mask

_OVER, _UNDER = 0.2, 1.8
"""Metres of the body over Cf and below it."""


def covered(camera: Camera, uv: Array, t_cf: Array, radius: float) -> Mask:
    """Pixels of Cs in which the body of Cf's wearer may be.

    The body is a capsule about a line through Cf, which is upright as Cf is: down is F's y axis. What is
    behind it is hidden, and nothing fits in between.

    Parameters
    ----------
    camera : Camera
        Cs.
    uv : (N, 2) float64
    t_cf : (4, 4) float64
        T_CF, metres.
    radius : float
        Of the body, metres.

    Returns
    -------
    (N,) bool
    """
    ray = np.reshape(camera.unproject(uv), (-1, 3))
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    down = t_cf[:3, 1]
    top = t_cf[:3, 3] - _OVER * down
    # Both across the ray: the point of the line nearest to it is the one nearest to zero there.
    start = top - (ray @ top)[:, None] * ray
    along = down - (ray @ down)[:, None] * ray
    square = np.maximum((along * along).sum(axis=1), 1e-12)
    reach = np.clip(-(start * along).sum(axis=1) / square, 0.0, _OVER + _UNDER)
    distance = np.linalg.norm(start + reach[:, None] * along, axis=1)
    ahead = (ray * (top + reach[:, None] * down)).sum(axis=1) > 0.0
    return np.asarray((distance < radius) & ahead)

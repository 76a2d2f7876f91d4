"""What a match with Cf cannot be, by what is known around it (METHOD section 9).

Where a wall repeats, the picture of one brick is that of another.  If the right one is not in Cf's picture,
another one on the epipolar line is the best there is, alone, and looks the same: no test of pixels tells, and
the others on that wall agree with it.  One such pair can turn a map.  What tells are the landmarks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from collabslam.types import Array, Mask

_AROUND = ((3, 0.25), (9, 0.5))
"""Landmarks around a new point that say how far away it may be: how many, and how far off they may be, as a
share of the image's width.  The farther off, the more of them have to agree."""
_ALIKE = 1.25  # factor between their distances, up to which they are of one surface
_GATE = 3.0
_FAR = 2.0  # standard deviations at which a match counts as another place than the expected one


class VisibleLandmarks(NamedTuple):
    """Points of Cs with a depth.

    Attributes
    ----------
    uv : (N, 2) float64
        Pixels in Cs.
    rho : (N,) float64
        Inverse distances from Cs, 1/m.
    sd : (N,) float64
        Their standard deviations, 1/m.
    """

    uv: Array
    rho: Array
    sd: Array


def far_from(place: Array, uv: Array, spread: Array) -> Mask:
    """(N,) bool: which places are more than 2 standard deviations from where they are expected.

    Parameters
    ----------
    place, uv : (N, 2) float64
        Pixels found, and expected.
    spread : (N, 2, 2) float64
        Covariance of what is expected, px^2.
    """
    off = place - uv
    return np.asarray(np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[..., None])[..., 0]) > _FAR**2)


def surface_around(uv: Array, known: VisibleLandmarks, width: int) -> VisibleLandmarks:
    """How far away points are if they are on the surface of the landmarks around them.

    That is of the three nearest, or, where one of these is far off, of the nine nearest (`_AROUND`).

    Parameters
    ----------
    uv : (N, 2) float64
        Pixels in Cs.
    known : VisibleLandmarks
        Landmarks in view; their sd says also by how much a surface differs beside them.
    width : int
        Of Cs's image, pixels.

    Returns
    -------
    VisibleLandmarks
        NaN where there are not as many landmarks near, or these are of no one surface.
    """
    rho, sd = np.full(len(uv), np.nan), np.full(len(uv), np.nan)
    apart = np.linalg.norm(uv[:, None] - known.uv[None], axis=2)
    order = np.argsort(apart, axis=1, kind="stable")
    asked = np.zeros(len(uv), np.bool_)
    for count, share in _AROUND:
        if len(known.uv) < count:
            break
        nearest = order[:, :count]
        near = np.take_along_axis(apart, nearest, axis=1)[:, -1] < share * width
        low, high = known.rho[nearest].min(axis=1), known.rho[nearest].max(axis=1)
        one = near & ~asked & (low > 0.0) & (high < _ALIKE * low)
        rho[one] = 0.5 * (low + high)[one]
        sd[one] = (known.sd[nearest].max(axis=1) + (high - low) / (2.0 * _GATE))[one]
        asked |= near
    return VisibleLandmarks(uv, rho, sd)


def unlike(new: VisibleLandmarks, around: VisibleLandmarks) -> Mask:
    """(N,) bool: which points are not as far away as what is around them, by 3 standard deviations."""
    return np.asarray(np.abs(new.rho - around.rho) > _GATE * np.hypot(new.sd, around.sd))

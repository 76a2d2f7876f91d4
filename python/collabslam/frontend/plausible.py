"""What a match with Cf cannot be, by what is known around it (METHOD section 9).

Where a wall repeats, the picture of one brick is that of another.  If the right one is not in Cf's picture,
another one on the epipolar line is the best there is, alone, and looks the same: no test of pixels tells, and
the others on that wall agree with it.  One such pair can turn a map.  What tells are the landmarks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from collabslam.types import Array, Mask

_NEIGHBOURS = 3  # landmarks around a new point that say how far away it may be
_AROUND = 0.25  # how far off they may be, as a share of the image's width
_ALIKE = 1.25  # factor between their distances, up to which they are of one surface
_GATE = 3.0
_FAR = 2.0  # standard deviations at which a match counts as another place than the expected one


class Seen(NamedTuple):
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


def surface_around(uv: Array, known: Seen, width: int) -> Seen:
    """How far away points are if they are on the surface of the three landmarks nearest to them.

    Parameters
    ----------
    uv : (N, 2) float64
        Pixels in Cs.
    known : Seen
        Landmarks in view; their sd says also by how much a surface differs beside them.
    width : int
        Of Cs's image, pixels.

    Returns
    -------
    Seen
        NaN where there are no three landmarks near, or these are of no one surface.
    """
    none = np.full(len(uv), np.nan)
    if len(known.uv) < _NEIGHBOURS:
        return Seen(uv, none, none)
    apart = np.linalg.norm(uv[:, None] - known.uv[None], axis=2)
    nearest = np.argsort(apart, axis=1, kind="stable")[:, :_NEIGHBOURS]
    low, high = known.rho[nearest].min(axis=1), known.rho[nearest].max(axis=1)
    near = np.take_along_axis(apart, nearest, axis=1)[:, -1] < _AROUND * width
    one = near & (low > 0.0) & (high < _ALIKE * low)
    sd = known.sd[nearest].max(axis=1) + (high - low) / (2.0 * _GATE)
    return Seen(uv, np.where(one, 0.5 * (low + high), none), np.where(one, sd, none))


def unlike(new: Seen, around: Seen) -> Mask:
    """(N,) bool: which points are not as far away as what is around them, by 3 standard deviations."""
    return np.asarray(np.abs(new.rho - around.rho) > _GATE * np.hypot(new.sd, around.sd))

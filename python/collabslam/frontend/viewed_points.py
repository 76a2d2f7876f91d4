"""Points of Cs that are looked for in a worn camera's view, and regions of images."""

from __future__ import annotations

import numpy as np

from collabslam.errors import InputError
from collabslam.types import Array, Image, Mask

Region = tuple[float, float, float, float]


class ViewedPoints:
    """Points of Cs, and what is known of their depth.

    Parameters
    ----------
    uv : (N, 2) float64
        Pixels in Cs.
    rho, rho_sd : (N,) float64, optional
        Inverse distance from Cs (1/m) and its standard deviation; NaN where unknown.

    Raises
    ------
    InputError
        If their numbers differ.
    """

    def __init__(self, uv: Array, rho: Array | None = None, rho_sd: Array | None = None) -> None:
        self.uv = np.asarray(uv, dtype=np.float64).reshape(-1, 2)
        unknown = np.full(len(self.uv), np.nan)
        self.rho = unknown if rho is None else np.asarray(rho, dtype=np.float64)
        self.rho_sd = unknown if rho_sd is None else np.asarray(rho_sd, dtype=np.float64)
        if not self.rho.shape == self.rho_sd.shape == unknown.shape:
            raise InputError(
                f"Give one inverse range and one standard deviation for each of the {len(unknown)} points."
            )


def whole(region: Region | None, image: Image) -> Region:
    """The region, or all of the image."""
    return region if region is not None else (0.0, 0.0, image.shape[1] - 1.0, image.shape[0] - 1.0)


def inside(uv: Array, region: Region) -> Mask:
    """(N,) bool: which pixels (N, 2) lie in a region."""
    return np.asarray(np.all((uv >= region[:2]) & (uv <= region[2:]), axis=1))

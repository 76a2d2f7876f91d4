"""What a match between the robot's view Cs and the worn camera's view Cf starts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam._core import Camera
from collabslam.errors import InputError
from collabslam.frontend.detect import Hidden
from collabslam.types import Array, Image, Mask

Region = tuple[float, float, float, float]


@dataclass(frozen=True)
class TwoViews:
    """Both views and their measured relative pose.

    Attributes
    ----------
    image_s, image_f : (H, W) uint8
    camera_s, camera_f : Camera
    t_cf : (4, 4) float64
        Measured pose of Cf relative to Cs: maps points of F into C, metres.
    covariance : (6, 6) float64
        Of ``t_cf`` over (translation, rotation), tangent on the right, m^2 and rad^2.
    roi_s, roi_f : (u0, v0, u1, v1) or None
        Region of interest in each image, pixels; None is the whole image.
    hidden_f : callable or None
        Which pixels of Cf are never scene.

    Raises
    ------
    InputError
        If the pose or its covariance has a wrong shape, or the covariance is not positive definite.
    """

    image_s: Image
    camera_s: Camera
    image_f: Image
    camera_f: Camera
    t_cf: Array
    covariance: Array
    roi_s: Region | None = None
    roi_f: Region | None = None
    hidden_f: Hidden | None = None

    def __post_init__(self) -> None:
        if np.shape(self.t_cf) != (4, 4) or np.shape(self.covariance) != (6, 6):
            raise InputError(
                "The worn camera's pose must be a (4, 4) array and its covariance a (6, 6) array."
            )
        try:
            np.linalg.cholesky(self.covariance)
        except np.linalg.LinAlgError as error:
            raise InputError("The covariance of the worn camera's pose is not positive definite.") from error


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

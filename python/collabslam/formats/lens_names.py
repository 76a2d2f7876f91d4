"""Cameras as COLMAP and the tools after it name them."""

from __future__ import annotations

from collabslam._core import Camera
from collabslam.errors import DataError

HALF_PIXEL = 0.5
"""Their pixels are counted from the corner of the first one, ours from its centre."""


def lens_of(camera: Camera) -> tuple[str, dict[str, float]]:
    """COLMAP's model and its parameters by name, in COLMAP's order, px.

    Parameters
    ----------
    camera : Camera

    Returns
    -------
    str
        ``PINHOLE``, ``OPENCV``, ``FULL_OPENCV`` or ``OPENCV_FISHEYE``.
    dict
        ``fx``, ``fy``, ``cx``, ``cy`` and the coefficients of the distortion.

    Raises
    ------
    DataError
        For Davison's one-parameter lens, which they do not know.
    """
    fx, fy, cx, cy = camera.intrinsics
    numbers = {"fx": fx, "fy": fy, "cx": cx + HALF_PIXEL, "cy": cy + HALF_PIXEL}
    values = list(camera.distortion)
    if camera.model == "pinhole":
        return "PINHOLE", numbers
    if camera.model == "fisheye":
        return "OPENCV_FISHEYE", numbers | dict(zip(("k1", "k2", "k3", "k4"), values, strict=True))
    if camera.model == "radtan":
        names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
        if len(values) == 4:
            return "OPENCV", numbers | dict(zip(names[:4], values, strict=True))
        return "FULL_OPENCV", numbers | dict(zip(names, values + [0.0] * (8 - len(values)), strict=True))
    raise DataError(
        f"COLMAP and nerfstudio know no lens '{camera.model}'; undistort the images, and run them as pinhole."
    )

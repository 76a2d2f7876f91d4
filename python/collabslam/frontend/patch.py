"""Landmark patches: captured once, then warped to the predicted view.

A patch is taken to be a small plane through its landmark that faces the camera which captured it.  The warp
to another view is affine: its matrix maps pixel offsets in the reference image to those in the other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from collabslam import _core
from collabslam._core import AffineMaps, Camera, WarpedPatches, WarpLimits
from collabslam.settings.frontend import PatchSettings
from collabslam.types import Array, Image

SIZE = 15
"""Side of the template that is correlated, pixels; odd."""
_MARGIN = 14  # pixels stored around the template's reach, so that rotating and shrinking it stays inside


@dataclass(frozen=True)
class Patch:
    """Image window around a landmark at the time it was captured.

    Attributes
    ----------
    pixels : (h, h) uint8
        Window whose centre pixel is ``uv_ref`` rounded to whole pixels.
    uv_ref : (2,) float64
        The landmark in the image that the window was cut from (u, v).
    t_wc : (4, 4) float64
        Camera pose at capture: maps points of C into W.
    inside : (4,) float64
        First and last column and row of the window that hold image (u0, v0, u1, v1); the rest repeats the
        edge.
    """

    pixels: Image
    uv_ref: Array
    t_wc: Array
    inside: Array


def capture(image: Image, uv: Array, t_wc: Array) -> list[Patch]:
    """Cut one patch per point.

    Parameters
    ----------
    image : (H, W) uint8
    uv : (N, 2) float64
        Points (u, v) inside the image.
    t_wc : (4, 4) float64
        Camera pose, shared by the patches.

    Returns
    -------
    list of N Patch
    """
    if len(uv) == 0:
        return []
    pose = np.array(t_wc, dtype=np.float64)
    pose.flags.writeable = False
    points = np.array(uv, dtype=np.float64).reshape(-1, 2)
    cut = _core.capture_windows(image, points, SIZE // 2 + _MARGIN)
    return [Patch(w, uv, pose, rest) for w, uv, rest in zip(cut.windows, points, cut.inside, strict=True)]


def affine_maps(
    camera_ref: Camera,
    uv_ref: Array,
    camera_now: Camera,
    t_now_ref: Array,
    inverse_range: Array,
) -> AffineMaps:
    """Predicted pixel in another view, and the affine map of pixel offsets into it.

    Parameters
    ----------
    camera_ref, camera_now : Camera
    uv_ref : (N, 2) float64
        Points in the reference image.
    t_now_ref : (4, 4) or (N, 4, 4) float64
        Maps points of the reference camera into the camera now.
    inverse_range : (N,) float64
        Inverse distance of each landmark from the reference camera, 1/m; NaN or 0: infinitely far, so that
        only the rotation counts.

    Returns
    -------
    AffineMaps
    """
    count = len(uv_ref)
    motion = np.broadcast_to(np.asarray(t_now_ref, dtype=np.float64), (count, 4, 4))
    return _core.affine_maps(camera_ref, uv_ref, camera_now, motion, inverse_range)


def inverse_maps(affine: Array) -> Array:
    """Inverses of (N, 2, 2) affine maps whose determinants are not zero."""
    a, b, c, d = affine[:, 0, 0], affine[:, 0, 1], affine[:, 1, 0], affine[:, 1, 1]
    return np.asarray(np.stack([d, -b, -c, a], axis=1).reshape(-1, 2, 2) / (a * d - b * c)[:, None, None])


def warp_templates(
    camera: Camera,
    patches: Sequence[Patch],
    t_wc_now: Array,
    points_w: Array,
    settings: PatchSettings | None = None,
) -> WarpedPatches:
    """Templates as the patches are expected to look from another pose.

    Parameters
    ----------
    camera : Camera
        The camera that captured the patches and that looks now.
    patches : sequence of N Patch
    t_wc_now : (4, 4) float64
        Pose of the viewing camera: maps its points into W.
    points_w : (N, 3) float64
        Landmarks in W, metres; a row of NaN means that the depth is unknown, then only the rotation between
        the poses is applied.
    settings : PatchSettings, optional

    Returns
    -------
    WarpedPatches
    """
    settings = settings or PatchSettings()
    return _core.warp_patches(
        camera,
        patches,
        t_wc_now,
        points_w,
        SIZE,
        limits(settings),
    )


def limits(settings: PatchSettings) -> WarpLimits:
    """Which warps the settings allow."""
    return WarpLimits(
        min_area=settings.min_area, max_area=settings.max_area, max_stretch=settings.max_stretch
    )

"""Landmark patches: captured once, then warped to the predicted view.

A patch is taken to be a small plane through its landmark that faces the camera which captured it.  The warp
to another view is affine: its matrix maps pixel offsets in the reference image to those in the other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from collabslam import _core
from collabslam._core import Camera
from collabslam.frontend.settings import PatchSettings
from collabslam.types import Array, Image, Mask


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


def capture(image: Image, uv: Array, t_wc: Array, settings: PatchSettings | None = None) -> list[Patch]:
    """Cut one patch per point.

    Parameters
    ----------
    image : (H, W) uint8
    uv : (N, 2) float64
        Points (u, v) inside the image.
    t_wc : (4, 4) float64
        Camera pose, shared by the patches.
    settings : PatchSettings, optional

    Returns
    -------
    list of N Patch
    """
    if len(uv) == 0:
        return []
    settings = settings or PatchSettings()
    half = settings.size // 2 + settings.margin
    height, width = image.shape
    pose = np.array(t_wc, dtype=np.float64)
    pose.flags.writeable = False
    points = np.array(uv, dtype=np.float64).reshape(-1, 2)
    corners = np.rint(points).astype(np.int64) - half
    last = np.array([width - 1, height - 1]) - corners
    inside = np.hstack([np.maximum(0, -corners), np.minimum(2 * half, last)]).astype(np.float64)
    patches = []
    reach = np.arange(2 * half + 1)
    for point, (u, v), rest in zip(points, corners.tolist(), inside, strict=True):
        window = image[max(0, v) : v + 2 * half + 1, max(0, u) : u + 2 * half + 1]
        if window.shape == (len(reach), len(reach)):
            window = window.copy()
        else:  # beyond the image's edge the edge repeats
            rows, columns = np.clip(v + reach, 0, height - 1), np.clip(u + reach, 0, width - 1)
            window = image[rows[:, None], columns]
        patches.append(Patch(window, point, pose, rest))
    return patches


def affine_maps(
    camera_ref: Camera,
    uv_ref: Array,
    camera_now: Camera,
    t_now_ref: Array,
    inverse_range: Array,
) -> tuple[Array, Array, Mask]:
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
    uv : (N, 2) float64
        Predicted pixel; NaN where the landmark is not in front of the camera.
    affine : (N, 2, 2) float64
        ``offset_now = affine @ offset_ref``.
    ok : (N,) bool
        Whether both are finite and the map keeps its orientation (determinant above 0).
    """
    count = len(uv_ref)
    motion = np.broadcast_to(np.asarray(t_now_ref, dtype=np.float64), (count, 4, 4))
    return _core.affine_maps(camera_ref, uv_ref, camera_now, motion, inverse_range)


def inverse_maps(affine: Array) -> Array:
    """Inverses of (N, 2, 2) affine maps whose determinants are not zero."""
    a, b, c, d = affine[:, 0, 0], affine[:, 0, 1], affine[:, 1, 0], affine[:, 1, 1]
    return np.asarray(np.stack([d, -b, -c, a], axis=1).reshape(-1, 2, 2) / (a * d - b * c)[:, None, None])


def usable_affine(affine: Array, settings: PatchSettings) -> Mask:
    """(N,) bool: whether a warp's change of area and its stretch are within the settings' bounds."""
    area = affine[:, 0, 0] * affine[:, 1, 1] - affine[:, 0, 1] * affine[:, 1, 0]
    squares = (affine**2).sum(axis=(1, 2))
    spread = np.sqrt(np.maximum(squares**2 - 4.0 * area**2, 0.0))
    stretched = np.sqrt((squares + spread) / np.maximum(squares - spread, 1e-12))
    bounded = (area >= settings.min_area) & (area <= settings.max_area)
    return np.asarray(bounded & (stretched <= settings.max_stretch))


def warp_templates(
    camera: Camera,
    patches: Sequence[Patch],
    t_wc_now: Array,
    points_w: Array,
    settings: PatchSettings | None = None,
    camera_now: Camera | None = None,
) -> tuple[Image, Mask, Array]:
    """Templates as the patches are expected to look from another pose.

    Parameters
    ----------
    camera : Camera
        The camera that captured the patches.
    patches : sequence of N Patch
    t_wc_now : (4, 4) float64
        Pose of the viewing camera: maps its points into W.
    points_w : (N, 3) float64
        Landmarks in W, metres; a row of NaN means that the depth is unknown, then only the rotation between
        the poses is applied.
    settings : PatchSettings, optional
    camera_now : Camera, optional
        The viewing camera; the capturing one unless given.

    Returns
    -------
    templates : (N, size, size) uint8
    ok : (N,) bool
        False where the change of area or the stretch is out of bounds, or the warp leaves the stored window.
    affine : (N, 2, 2) float64
        Maps pixel offsets at capture to pixel offsets now.
    """
    settings = settings or PatchSettings()
    count = len(patches)
    if count == 0:
        size = settings.size
        return np.empty((0, size, size), np.uint8), np.empty(0, np.bool_), np.empty((0, 2, 2))
    # Concatenating is many times faster than stacking.
    t_wc_ref = np.concatenate([patch.t_wc for patch in patches]).reshape(-1, 4, 4)
    uv_ref = np.concatenate([patch.uv_ref for patch in patches]).reshape(-1, 2)
    inside = np.concatenate([patch.inside for patch in patches]).reshape(-1, 4)
    away = np.asarray(points_w, dtype=np.float64) - t_wc_ref[:, :3, 3]
    distance = np.sqrt((away**2).sum(axis=1))
    now = np.asarray(t_wc_now, dtype=np.float64)
    motion = np.zeros((count, 4, 4))
    motion[:, :3, :3] = now[:3, :3].T @ t_wc_ref[:, :3, :3]
    motion[:, :3, 3] = (t_wc_ref[:, :3, 3] - now[:3, 3]) @ now[:3, :3]
    rho = 1.0 / np.where(np.isfinite(distance), np.maximum(distance, 1e-6), np.inf)
    _, affine, ok = affine_maps(camera, uv_ref, camera_now or camera, motion, rho)
    ok &= usable_affine(affine, settings)
    affine = np.where(ok[:, None, None], affine, np.eye(2))
    side = patches[0].pixels.shape[0]
    local = uv_ref - np.rint(uv_ref) + (side - 1) / 2.0
    atlas = np.concatenate([patch.pixels for patch in patches])
    rows = np.stack([np.zeros(count), side * np.arange(count)], axis=1)
    templates, reach = _core.sample_templates(atlas, local + rows, affine, settings.size)
    ok &= np.all((local - reach >= inside[:, :2] - 0.5) & (local + reach <= inside[:, 2:] + 0.5), axis=1)
    return templates, ok, affine

"""Landmark patches: captured once, then warped to the predicted view.

A patch is taken to be a small plane through its landmark that faces the camera which captured it.  The warp
to another view is affine: its matrix maps pixel offsets in the reference image to those in the other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.frontend.settings import PatchSettings
from collabslam.types import Array, Image, Mask

_PROBE = 4.0  # pixels from the patch's centre at which the warp is measured
_ATLAS = 250  # patches whose windows are stacked into one image
_SHRINK = 0.75  # linear scale below which a template is averaged from 2 x 2 samples per pixel


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
    settings = settings or PatchSettings()
    half = settings.size // 2 + settings.margin
    height, width = image.shape
    pose = np.array(t_wc, dtype=np.float64)
    pose.flags.writeable = False
    patches = []
    for point in np.asarray(uv, dtype=np.float64).reshape(-1, 2):
        u, v = (int(x) for x in np.rint(point))
        left, top = max(0, half - u), max(0, half - v)
        right, bottom = max(0, u + half + 1 - width), max(0, v + half + 1 - height)
        window = image[v - half + top : v + half + 1 - bottom, u - half + left : u + half + 1 - right]
        if left or top or right or bottom:
            window = np.pad(window, ((top, bottom), (left, right)), mode="edge")
        inside = np.array([left, top, 2 * half - right, 2 * half - bottom], dtype=np.float64)
        patches.append(Patch(np.array(window, dtype=np.uint8), point.copy(), pose, inside))
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
    uv_ref = np.asarray(uv_ref, dtype=np.float64).reshape(-1, 2)
    count = len(uv_ref)
    probes = np.array([[0.0, 0.0], [_PROBE, 0.0], [0.0, _PROBE]])
    rays = camera_ref.unproject((uv_ref[None] + probes[:, None]).reshape(-1, 2)).reshape(3, count, 3)
    # Where each ray meets the plane through the landmark that faces the reference camera, over the range.
    on_plane = rays / np.maximum(np.einsum("kni,ni->kn", rays, rays[0]), 1e-6)[..., None]
    rho = np.where(np.isfinite(inverse_range) & (inverse_range > 0.0), inverse_range, 0.0)
    motion = np.broadcast_to(np.asarray(t_now_ref, dtype=np.float64), (count, 4, 4))
    seen = np.einsum("nij,knj->kni", motion[:, :3, :3], on_plane) + (rho[:, None] * motion[:, :3, 3])[None]
    front = np.all(seen[..., 2] > 1e-6, axis=0)
    uv, _ = camera_now.project(np.where(front[None, :, None], seen, [0.0, 0.0, 1.0]).reshape(-1, 3))
    uv = uv.reshape(3, count, 2)
    affine = np.stack([uv[1] - uv[0], uv[2] - uv[0]], axis=2) / _PROBE
    finite = front & np.all(np.isfinite(uv), axis=(0, 2))
    area = affine[:, 0, 0] * affine[:, 1, 1] - affine[:, 0, 1] * affine[:, 1, 0]
    ok = finite & (np.where(finite, area, 0.0) > 0.0)
    centre = np.where(finite[:, None], uv[0], np.nan)
    return centre, np.where(ok[:, None, None], affine, np.eye(2)), ok


def inverse_maps(affine: Array) -> Array:
    """Inverses of (N, 2, 2) affine maps whose determinants are not zero."""
    a, b, c, d = affine[:, 0, 0], affine[:, 0, 1], affine[:, 1, 0], affine[:, 1, 1]
    return np.asarray(np.stack([d, -b, -c, a], axis=1).reshape(-1, 2, 2) / (a * d - b * c)[:, None, None])


def sample_templates(atlas: Image, centres: Array, affine: Array, size: int) -> tuple[Image, Array]:
    """Templates sampled around points of an image under affine maps.

    Parameters
    ----------
    atlas : (H, W) uint8
    centres : (N, 2) float64
        Centre of each template in the atlas (u, v).
    affine : (N, 2, 2) float64
        Map from atlas offsets to template offsets, determinant above 0.
    size : int
        Side of a template, pixels (odd).

    Returns
    -------
    templates : (N, size, size) uint8
        Where the map shrinks, each pixel is the mean of 2 x 2 samples.
    reach : (N, 2) float64
        Largest distance in u and v between a sample and its centre, atlas pixels.
    """
    count = len(centres)
    templates = np.empty((count, size, size), dtype=np.uint8)
    inverse = inverse_maps(affine)
    reach = (size - 1) / 2.0 * np.abs(inverse).sum(axis=2)
    scale = np.linalg.norm(inverse, 2, axis=(1, 2)) if count else np.empty(0)
    for factor, chosen in (
        (1, np.flatnonzero(scale <= 1.0 / _SHRINK)),
        (2, np.flatnonzero(scale > 1.0 / _SHRINK)),
    ):
        if len(chosen) == 0:
            continue
        samples = size * factor
        line = (np.arange(samples) + 0.5) / factor - size / 2.0
        x, y = np.meshgrid(line, line)
        grid = np.stack([x.ravel(), y.ravel()])
        maps = (inverse[chosen] @ grid + centres[chosen, :, None]).astype(np.float32)
        shape = (len(chosen) * samples, samples)
        out = cv2.remap(
            atlas,
            maps[:, 0].reshape(shape),
            maps[:, 1].reshape(shape),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        ).reshape(len(chosen), samples, samples)
        if factor == 2:
            sums = out.reshape(len(chosen), size, 2, size, 2).astype(np.uint16).sum(axis=(2, 4))
            out = ((sums + 2) // 4).astype(np.uint8)
        templates[chosen] = out
    return templates, reach


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
    if count > _ATLAS:  # the stacked windows are limited to 2^15 rows
        parts = [
            warp_templates(
                camera, patches[k : k + _ATLAS], t_wc_now, points_w[k : k + _ATLAS], settings, camera_now
            )
            for k in range(0, count, _ATLAS)
        ]
        templates, ok, affine = (np.concatenate(part) for part in zip(*parts, strict=True))
        return templates, ok, affine
    t_wc_ref = np.stack([patch.t_wc for patch in patches])
    uv_ref = np.stack([patch.uv_ref for patch in patches])
    inside = np.stack([patch.inside for patch in patches])
    distance = np.linalg.norm(np.asarray(points_w, dtype=np.float64) - t_wc_ref[:, :3, 3], axis=1)
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
    templates, reach = sample_templates(atlas, local + rows, affine, settings.size)
    ok &= np.all((local - reach >= inside[:, :2] - 0.5) & (local + reach <= inside[:, 2:] + 0.5), axis=1)
    return templates, ok, affine

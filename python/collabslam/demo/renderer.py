"""A small exact renderer of textured rectangles.

METHOD
An ideal pinhole picture is drawn at twice the resolution. Each rectangle is cut in cells whose depth varies
little, each cell is clipped at the near plane, and its texture is warped by the cell's homography; 1/z is
affine in the pixel, so the depth test is exact. Textures are prefiltered apart along their rows and columns
(a rip-map), with the level chosen per cell, so that walls seen at a grazing angle neither alias nor blur.
The picture is then smoothed by a Gaussian, which stands for the blur of lens and pixel, and resampled
through the camera's own distortion. There is no motion blur: the shutter is short.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.demo.textures import Grey, Shade
from collabslam.demo.world import Panel
from collabslam.types import Array, Indices

SCALE = 2
"""Samples per pixel along each axis."""
BLUR = 0.45
"""Standard deviation of the optical blur, pixels."""
NEAR = 0.05
"""Depth of the near plane, metres."""

_DEPTH_RATIO = 1.7
_MAX_CUTS = 5
_EDGE = 1e-3


class RipMap:
    """A texture and its reductions by powers of two, apart along rows and columns, made when asked for."""

    def __init__(self, image: Grey) -> None:
        self._levels: dict[tuple[int, int], Grey] = {(0, 0): image}

    def level(self, along_u: int, along_v: int) -> Grey:
        """The texture reduced 2**along_u times in width and 2**along_v times in height."""
        key = (along_u, along_v)
        if key not in self._levels:
            h, w = self._levels[0, 0].shape
            size = (max(1, w >> along_u), max(1, h >> along_v))
            reduced = cv2.resize(self._levels[0, 0], size, interpolation=cv2.INTER_AREA)
            self._levels[key] = np.asarray(reduced, np.uint8)
        return self._levels[key]


@dataclass(frozen=True)
class _Lens:
    """The ideal picture's size and matrix, and the way from it to the camera's pixels."""

    width: int
    height: int
    matrix: Array
    map_u: Shade
    map_v: Shade
    rays: Array = field(repr=False)

    @classmethod
    def of(cls, camera: Camera) -> _Lens:
        v, u = np.mgrid[0 : camera.height, 0 : camera.width]
        rays = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
        xy = (rays[:, :2] / rays[:, 2:]).reshape(camera.height, camera.width, 2)
        focal = SCALE * np.array(camera.intrinsics[:2])
        low = np.floor(xy.min(axis=(0, 1)) * focal) - 3
        size = np.ceil(xy.max(axis=(0, 1)) * focal) + 3 - low + 1
        matrix = np.array([[focal[0], 0, -low[0]], [0, focal[1], -low[1]], [0, 0, 1.0]])
        maps = (xy * focal - low).astype(np.float32)
        unit = np.concatenate([xy, np.ones((*xy.shape[:2], 1))], axis=2)
        return cls(int(size[0]), int(size[1]), matrix, maps[..., 0].copy(), maps[..., 1].copy(), unit)


class Renderer:
    """Draws a scene of panels for any camera of `collabslam._core.Camera` that sees less than 180 degrees.

    Parameters
    ----------
    panels : sequence of Panel
        The scene, world frame, metres.
    """

    def __init__(self, panels: Sequence[Panel]) -> None:
        self._maps = [RipMap(p.image) for p in panels]
        self._texels = np.array([p.image.shape[::-1] for p in panels], float).reshape(-1, 2)
        self._origin = np.array([p.origin for p in panels]).reshape(-1, 3)
        self._u = np.array([p.u for p in panels]).reshape(-1, 3)
        self._v = np.array([p.v for p in panels]).reshape(-1, 3)
        self._lenses: dict[tuple[object, ...], _Lens] = {}

    def _lens(self, camera: Camera) -> _Lens:
        key = (camera.model, camera.width, camera.height, tuple(camera.intrinsics), tuple(camera.distortion))
        if key not in self._lenses:
            self._lenses[key] = _Lens.of(camera)
        return self._lenses[key]

    def _in_camera(self, pose: Array) -> Array:
        """(N, 3, 3): the columns [u, v, origin] of each panel in the camera's frame."""
        r, c = pose[:3, :3], pose[:3, 3]
        return np.stack([self._u @ r, self._v @ r, (self._origin - c) @ r], axis=2)

    def render(self, pose: Array, camera: Camera) -> Grey:
        """The picture (H, W) uint8 that `camera` takes at `pose` (4, 4; T_WC), free of noise.

        A point of the scene appears at `camera.project` of its coordinates in C; uncovered pixels are black.
        """
        lens = self._lens(camera)
        frames = self._in_camera(pose)
        picture = np.zeros((lens.height, lens.width), np.uint8)
        inverse_depth = np.zeros((lens.height, lens.width), np.float32)
        for k, bounds in _cells(frames, lens):
            self._draw(k, bounds, frames[k], lens, picture, inverse_depth)
        picture = cv2.GaussianBlur(picture, (0, 0), BLUR * SCALE)  # type: ignore[assignment]
        return cv2.remap(picture, lens.map_u, lens.map_v, cv2.INTER_LINEAR).astype(np.uint8, copy=False)

    def depth(self, pose: Array, camera: Camera) -> Array:
        """Depth z (H, W), metres, of what each pixel's centre sees, by casting rays; inf for nothing."""
        rays = self._lens(camera).rays
        nearest = np.zeros(rays.shape[:2])
        for frame in self._in_camera(pose):
            if abs(np.linalg.det(frame)) < 1e-12:
                continue
            s, t, q = np.moveaxis(rays @ np.linalg.inv(frame).T, 2, 0)
            hit = (q > nearest) & (s >= 0) & (s <= q) & (t >= 0) & (t <= q)
            nearest[hit] = q[hit]
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / nearest)

    def _draw(
        self, k: int, bounds: Array, frame: Array, lens: _Lens, picture: Grey, inverse_depth: Shade
    ) -> None:
        """Draw the part [s0, s1] x [t0, t1] of panel `k` where it is in front of what is there."""
        s0, s1, t0, t1 = bounds
        corners = np.array([[s0, t0, 1], [s1, t0, 1], [s1, t1, 1], [s0, t1, 1.0]]) @ frame.T
        polygon = _clip(corners)
        if len(polygon) < 3:
            return
        image = polygon @ lens.matrix.T
        image = image[:, :2] / image[:, 2:]
        low, high = image.min(axis=0), image.max(axis=0)
        x0, y0 = max(0, int(np.ceil(low[0] - _EDGE))), max(0, int(np.ceil(low[1] - _EDGE)))
        x1, y1 = min(lens.width - 1, int(high[0] + _EDGE)), min(lens.height - 1, int(high[1] + _EDGE))
        if x0 > x1 or y0 > y1:
            return
        homography = lens.matrix @ frame
        if abs(np.linalg.det(homography)) < 1e-9:
            return
        back = np.asarray(np.linalg.inv(homography), np.float64)  # pixel -> (s, t, 1) / z
        q = back[2]
        xs, ys = np.arange(x0, x1 + 1), np.arange(y0, y1 + 1)
        here = np.add.outer((q[1] * ys + q[2]).astype(np.float32), (q[0] * xs).astype(np.float32))
        window = (slice(y0, y1 + 1), slice(x0, x1 + 1))
        visible = here > inverse_depth[window]
        left, right = _spans(image, ys)
        columns = xs.astype(np.float32)
        visible &= columns >= left[:, None]
        visible &= columns <= right[:, None]
        if not visible.any():
            return
        inside = np.clip(image, 0.0, np.array([lens.width - 1.0, lens.height - 1.0]))
        level = _levels(back, inside, self._texels[k])
        texture = self._maps[k].level(*level)
        h, w = texture.shape
        to_texel = np.array([[w, 0, -0.5], [0, h, -0.5], [0, 0, 1.0]]) @ back @ _shift(x0, y0)
        warped = cv2.warpPerspective(
            texture,
            to_texel,
            (len(xs), len(ys)),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        np.copyto(picture[window], warped, where=visible)
        np.copyto(inverse_depth[window], here, where=visible)


def _shift(x: float, y: float) -> Array:
    return np.array([[1.0, 0, x], [0, 1.0, y], [0, 0, 1.0]])


def _cells(frames: Array, lens: _Lens) -> list[tuple[int, Array]]:
    """Cut the panels in view in cells (panel, [s0, s1, t0, t1]) of limited depth ratio, nearest first."""
    index = np.arange(len(frames))
    bounds = np.tile([0.0, 1.0, 0.0, 1.0], (len(frames), 1))
    view = lens.matrix.copy()
    view[0] /= lens.width - 1
    view[1] /= lens.height - 1
    done: list[tuple[float, int, Array]] = []
    for cut in range(_MAX_CUTS + 1):
        s, t = bounds[:, [0, 1, 1, 0]], bounds[:, [2, 2, 3, 3]]
        st1 = np.stack([s, t, np.ones_like(s)], axis=2)
        points = np.einsum("nij,nkj->nki", frames[index] if len(index) else np.zeros((0, 3, 3)), st1)
        p, z = points @ view.T, points[..., 2]
        out = (p[..., :2] < 0).all(axis=1).any(axis=1) | (p[..., :2] > z[..., None]).all(axis=1).any(axis=1)
        seen = ~out & (z > NEAR).any(axis=1)
        index, bounds, z = index[seen], bounds[seen], z[seen]
        nearest = np.maximum(z.min(axis=1), 0.25)
        whole = (z.max(axis=1) < _DEPTH_RATIO * nearest) | (cut == _MAX_CUTS)
        done += zip(z.mean(axis=1)[whole].tolist(), index[whole].tolist(), bounds[whole], strict=True)
        index, bounds, z = index[~whole], bounds[~whole], z[~whole]
        along_u = np.abs(z[:, 1] - z[:, 0]) >= np.abs(z[:, 3] - z[:, 0])
        first, second = bounds.copy(), bounds.copy()
        for axis, chosen in ((0, along_u), (2, ~along_u)):
            middle = bounds[chosen, axis : axis + 2].mean(axis=1)
            first[chosen, axis + 1] = middle
            second[chosen, axis] = middle
        index, bounds = np.tile(index, 2), np.concatenate([first, second])
    done.sort(key=lambda cell: cell[0])
    return [(k, b) for _, k, b in done]


def _clip(corners: Array) -> Array:
    """The part of a convex polygon (N, 3) in front of the near plane."""
    z = corners[:, 2]
    if (z >= NEAR).all():
        return corners
    kept = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] >= NEAR:
            kept.append(a)
        if (a[2] >= NEAR) != (b[2] >= NEAR):
            kept.append(a + (NEAR - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(kept).reshape(-1, 3)


def _spans(polygon: Array, rows: Indices) -> tuple[Shade, Shade]:
    """First and last column (real) of a convex polygon (N, 2) in each row; first > last off the polygon."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    dy = b[:, 1] - a[:, 1]
    steep = np.abs(dy) > 1e-12
    a, b, dy = a[steep], b[steep], dy[steep]
    y = rows[:, None]
    x = a[:, 0] + (y - a[:, 1]) * ((b[:, 0] - a[:, 0]) / dy)
    met = (y >= np.minimum(a[:, 1], b[:, 1]) - _EDGE) & (y <= np.maximum(a[:, 1], b[:, 1]) + _EDGE)
    left = np.where(met, x, np.inf).min(axis=1, initial=np.inf) - _EDGE
    right = np.where(met, x, -np.inf).max(axis=1, initial=-np.inf) + _EDGE
    return left.astype(np.float32), right.astype(np.float32)


def _levels(back: Array, points: Array, texels: Array) -> tuple[int, int]:
    """Levels along u and v: at the sharpest of `points` a sample steps over 1 to 2 texels."""
    x = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ back.T
    q = x[:, 2:]
    step_x = (back[:2, 0] - x[:, :2] / q * back[2, 0]) / q
    step_y = (back[:2, 1] - x[:, :2] / q * back[2, 1]) / q
    step = np.hypot(step_x, step_y).min(axis=0) * texels
    along_u, along_v = np.floor(np.log2(np.maximum(step, 1.0)))
    return int(along_u), int(along_v)

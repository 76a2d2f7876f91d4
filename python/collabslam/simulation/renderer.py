"""A small exact renderer of textured rectangles.

METHOD
An ideal pinhole picture is drawn at twice the resolution. Each rectangle is cut in cells whose depth varies
little, each cell is clipped at the near plane, and its texture is warped by the cell's homography; 1/z is
affine in the pixel, so the depth test is exact. Textures are prefiltered apart along their rows and columns
(a rip-map), with the level chosen per cell, so that walls seen at a grazing angle neither alias nor blur.
The picture is then smoothed by a Gaussian, which stands for the blur of lens and pixel, and resampled
through the camera's own distortion. A shutter that stays open blurs it along each pixel's own motion, which
follows from its depth; one that rolls takes each row from where it was on that motion when the row was read.
Both follow the camera's motion alone: bodies that move are swept as if they stood still meanwhile. A glossy
floor (z = 0) adds the scene's mirror image.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import ceil, floor
from typing import NamedTuple

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.geometry import pose_inverse
from collabslam.simulation.textures import Grey, Shade
from collabslam.simulation.world import Panel
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
_MOST_SHUTTER_STEPS = 8
_COARSE = 4
_GLOSS_BLUR = 2.5
_MARGIN, _SWEPT_MARGIN = 3, 48

Mover = tuple["Renderer", Array]
"""A body that moves, and its pose (4, 4) in the world."""


@dataclass(frozen=True)
class Shutter:
    """How long a picture takes, and how the camera moves meanwhile.

    Attributes
    ----------
    motion : (4, 4) float64
        Pose of C at the end of it all in C at its beginning; the pose of the picture is that in the middle.
    exposure : float
        Seconds that each row is exposed, above 0.
    readout : float
        Seconds from the first row's exposure to the last row's: 0 where all are exposed together.
    """

    motion: Array
    exposure: float
    readout: float = 0.0

    @classmethod
    def along(cls, path: Callable[[float], Array], t: float, exposure: float, readout: float) -> Shutter:
        """Of a camera whose pose T_WC (4, 4) at each time is known, about the time `t`, seconds."""
        half = 0.5 * (exposure + readout)
        return cls(pose_inverse(path(t - half)) @ path(t + half), exposure, readout)


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
    scale: float
    matrix: Array
    map_u: Shade
    map_v: Shade
    rays: Array = field(repr=False)
    numbers: Array = field(repr=False)
    """0, 1, 2.. to the last row or column of the ideal picture."""

    @classmethod
    def of(cls, camera: Camera, scale: float, margin: int) -> _Lens:
        """Of a camera; the ideal picture reaches `margin` of its own pixels beyond what the camera sees."""
        v, u = np.mgrid[0 : camera.height, 0 : camera.width]
        rays = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
        xy = (rays[:, :2] / rays[:, 2:]).reshape(camera.height, camera.width, 2)
        focal = scale * np.array(camera.intrinsics[:2])
        low = np.floor(xy.min(axis=(0, 1)) * focal) - margin
        size = np.ceil(xy.max(axis=(0, 1)) * focal) + margin - low + 1
        matrix = np.array([[focal[0], 0, -low[0]], [0, focal[1], -low[1]], [0, 0, 1.0]])
        maps = (xy * focal - low).astype(np.float32)
        unit = np.concatenate([xy, np.ones((*xy.shape[:2], 1))], axis=2)
        numbers = np.arange(int(size.max()), dtype=np.float64)
        map_u, map_v = maps[..., 0].copy(), maps[..., 1].copy()
        return cls(int(size[0]), int(size[1]), scale, matrix, map_u, map_v, unit, numbers)


@dataclass
class _Canvas:
    """What is drawn: grey, 1 / z, and where a glossy panel is seen, how glossy it is."""

    picture: Grey
    inverse_depth: Shade
    gloss: Shade | None

    @classmethod
    def blank(cls, lens: _Lens, *, glossy: bool) -> _Canvas:
        shape = (lens.height, lens.width)
        gloss = np.zeros(shape, np.float32) if glossy else None
        return cls(np.zeros(shape, np.uint8), np.zeros(shape, np.float32), gloss)


@dataclass(frozen=True)
class _Things:
    """Panels to draw: columns [u, v, origin] in the camera (N, 3, 3), texture, texels (N, 2), gloss (N,)."""

    frames: Array
    maps: Sequence[RipMap]
    texels: Array
    gloss: Array


class _Cell(NamedTuple):
    """A part of a panel in the ideal picture: corners (M, 2), pixel -> (s, t, 1) / z, its texture's level."""

    panel: int
    image: Array
    back: Array
    level: tuple[int, int]


class Renderer:
    """Draws a scene of panels for any camera of `collabslam._core.Camera` that sees less than 180 degrees.

    Parameters
    ----------
    panels : sequence of Panel
        The scene, world frame, metres.
    scale : float
        Samples per pixel along each axis: fewer are quicker, more smooth the panels' edges better.
    """

    def __init__(self, panels: Sequence[Panel], *, scale: float = SCALE) -> None:
        self._scale = scale
        self._maps = [RipMap(p.image) for p in panels]
        self._texels = np.array([p.image.shape[::-1] for p in panels], float).reshape(-1, 2)
        self._origin = np.array([p.origin for p in panels]).reshape(-1, 3)
        self._u = np.array([p.u for p in panels]).reshape(-1, 3)
        self._v = np.array([p.v for p in panels]).reshape(-1, 3)
        self._gloss = np.array([p.gloss for p in panels], float)
        self._lenses: dict[tuple[object, ...], _Lens] = {}

    def _lens(self, camera: Camera, margin: int = _MARGIN) -> _Lens:
        size = (camera.model, camera.width, camera.height, margin)
        key = (*size, tuple(camera.intrinsics), tuple(camera.distortion))
        if key not in self._lenses:
            self._lenses[key] = _Lens.of(camera, self._scale, margin)
        return self._lenses[key]

    def _in_camera(self, pose: Array) -> Array:
        """(N, 3, 3): the columns [u, v, origin] of each panel in the camera's frame."""
        r, c = pose[:3, :3], pose[:3, 3]
        return np.stack([self._u @ r, self._v @ r, (self._origin - c) @ r], axis=2)

    def _mapped(self, transform: Array) -> Array:
        """(N, 3, 3): the columns [u, v, origin] of each panel after an affine transform (4, 4)."""
        a, b = transform[:3, :3], transform[:3, 3]
        return np.stack([self._u @ a.T, self._v @ a.T, self._origin @ a.T + b], axis=2)

    def render(
        self, pose: Array, camera: Camera, movers: Sequence[Mover] = (), shutter: Shutter | None = None
    ) -> Grey:
        """The picture (H, W) uint8 that `camera` takes, free of noise.

        A point of the scene appears at `camera.project` of its coordinates in C; uncovered pixels are black.

        Parameters
        ----------
        pose : (4, 4) float64
            T_WC, at the middle of the exposure of the middle row.
        camera : Camera
        movers : sequence of (Renderer, (4, 4) float64)
            Bodies that move, each with its pose in the world.
        shutter : Shutter, optional
            It is short, for all rows together, if left out.
        """
        lens = self._lens(camera, _MARGIN if shutter is None else _SWEPT_MARGIN)
        canvas = _Canvas.blank(lens, glossy=bool(self._gloss.any()))
        things = self._things(self._in_camera(pose), [(m, pose_inverse(pose) @ t) for m, t in movers])
        _draw_all(things, lens, canvas)
        if canvas.gloss is not None:
            mirror = pose_inverse(pose) @ np.diag([1.0, 1.0, -1.0, 1.0])
            dull = self._things(self._mapped(mirror), [(m, mirror @ t) for m, t in movers])
            _add_reflection(canvas, dull, lens)
        picture = cv2.GaussianBlur(canvas.picture, (0, 0), BLUR * lens.scale)
        if shutter is not None:
            return _swept(np.asarray(picture, np.uint8), canvas.inverse_depth, lens, shutter)
        return cv2.remap(picture, lens.map_u, lens.map_v, cv2.INTER_LINEAR).astype(np.uint8, copy=False)

    def _things(self, frames: Array, movers: Sequence[Mover]) -> _Things:
        """This scene's panels and those of the bodies, whose transforms map into the camera's frame."""
        if not movers:
            return _Things(frames, self._maps, self._texels, self._gloss)
        bodies = [m for m, _ in movers]
        return _Things(
            np.concatenate([frames, *(m._mapped(t) for m, t in movers)]),
            [*self._maps, *(x for m in bodies for x in m._maps)],
            np.concatenate([self._texels, *(m._texels for m in bodies)]),
            np.concatenate([self._gloss, *(m._gloss for m in bodies)]),
        )

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


def _draw_all(things: _Things, lens: _Lens, canvas: _Canvas) -> None:
    for cell in _seen(things, _cells(things.frames, lens), lens):
        _draw(things, cell, lens, canvas)


def _seen(things: _Things, cells: list[tuple[int, Array]], lens: _Lens) -> Iterator[_Cell]:
    """What each of these parts of panels is in the ideal picture, but for those that are not in it."""
    if not cells:
        return
    panels, part = np.unique([k for k, _ in cells], return_inverse=True)
    homographies = lens.matrix @ things.frames[panels]
    flat = np.abs(np.linalg.det(homographies)) < 1e-9
    homographies[flat] = np.eye(3)
    every = np.linalg.inv(homographies)[part]  # pixel -> (s, t, 1) / z
    bounds = np.stack([b for _, b in cells])
    s, t = bounds[:, [0, 1, 1, 0]], bounds[:, [2, 2, 3, 3]]
    corners = np.stack([s, t, np.ones_like(s)], axis=2)
    corners = corners @ things.frames[panels][part].transpose(0, 2, 1)
    whole = (corners[..., 2] >= NEAR).all(axis=1).tolist()
    with np.errstate(divide="ignore", invalid="ignore"):  # of those that the near plane cuts
        images = corners @ lens.matrix.T
        images = images[..., :2] / images[..., 2:]
        levels = _levels(every, _inside(images, lens), things.texels[panels][part])
    for (k, _), n, polygon, image, back, level, in_front in zip(
        cells, part.tolist(), corners, images, every, levels, whole, strict=True
    ):
        if flat[n]:
            continue
        if in_front:
            yield _Cell(k, image, back, (int(level[0]), int(level[1])))
            continue
        cut = _clip(polygon)
        if len(cut) >= 3:
            image = cut @ lens.matrix.T
            image = image[:, :2] / image[:, 2:]
            level = _levels(back[None], _inside(image, lens)[None], things.texels[k][None])[0]
            yield _Cell(k, image, back, (int(level[0]), int(level[1])))


def _inside(image: Array, lens: _Lens) -> Array:
    return np.clip(image, 0.0, np.array([lens.width - 1.0, lens.height - 1.0]))


def _add_reflection(canvas: _Canvas, mirrored: _Things, lens: _Lens) -> None:
    """Mix the mirror image of all panels that do not shine themselves into those that do, in place."""
    shining = canvas.gloss
    if shining is None or not shining.any():
        return
    dull = np.flatnonzero(mirrored.gloss == 0.0).tolist()
    things = _Things(
        mirrored.frames[dull], [mirrored.maps[k] for k in dull], mirrored.texels[dull], mirrored.gloss[dull]
    )
    below = _Canvas.blank(lens, glossy=False)
    _draw_all(things, lens, below)
    image = cv2.GaussianBlur(below.picture, (0, 0), _GLOSS_BLUR * lens.scale)
    where = (shining > 0.0) & (below.inverse_depth > 0.0)
    mixed = canvas.picture + shining * (image.astype(np.float32) - 128.0)
    np.copyto(canvas.picture, np.clip(mixed, 0, 255).astype(np.uint8), where=where)


def _swept(picture: Grey, inverse_depth: Shade, lens: _Lens, shutter: Shutter) -> Grey:
    """Mean of the picture over each row's exposure: each pixel is followed along its own motion."""
    h, w = lens.map_u.shape
    coarse = (w // _COARSE, h // _COARSE)
    rays = cv2.resize(lens.rays.astype(np.float32), coarse, interpolation=cv2.INTER_AREA)
    near = cv2.remap(inverse_depth, lens.map_u, lens.map_v, cv2.INTER_NEAREST)
    near = cv2.resize(near, coarse, interpolation=cv2.INTER_AREA)
    back = pose_inverse(shutter.motion)
    ends = rays @ back[:3, :3].T.astype(np.float32) + near[..., None] * back[:3, 3].astype(np.float32)
    focal = np.array([lens.matrix[0, 0], lens.matrix[1, 1]], np.float32)
    flow = (ends[..., :2] / ends[..., 2:] - rays[..., :2] / rays[..., 2:]) * focal
    exposed = shutter.exposure / (shutter.exposure + shutter.readout)
    row: Array | float = 0.0
    if shutter.readout > 0.0:
        row = (1.0 - exposed) * (np.arange(h)[:, None] / max(h - 1, 1) - 0.5)
    longest = exposed * float(np.abs(flow).max()) / lens.scale
    steps = min(_MOST_SHUTTER_STEPS, 1 + int(np.ceil(longest)))
    flow_u, flow_v = (cv2.resize(np.ascontiguousarray(flow[..., k]), (w, h)) for k in (0, 1))
    total = np.zeros((h, w), np.float32)
    for share in (np.arange(steps) + 0.5) / steps - 0.5:
        f = np.asarray(exposed * share - row, np.float32)
        u, v = lens.map_u + f * flow_u, lens.map_v + f * flow_v
        moved = cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        cv2.accumulate(moved, total)
    total /= np.float32(steps)
    return np.rint(total, out=total).astype(np.uint8)


def _draw(things: _Things, cell: _Cell, lens: _Lens, canvas: _Canvas) -> None:
    """Draw a part of a panel where it is in front of what is there."""
    polygon = cell.image.tolist()
    across, down = [x for x, _ in polygon], [y for _, y in polygon]
    x0, y0 = max(0, ceil(min(across) - _EDGE)), max(0, ceil(min(down) - _EDGE))
    x1, y1 = min(lens.width - 1, int(max(across) + _EDGE)), min(lens.height - 1, int(max(down) + _EDGE))
    if x0 > x1 or y0 > y1:
        return
    q = cell.back[2]
    xs, ys = lens.numbers[x0 : x1 + 1], lens.numbers[y0 : y1 + 1]
    here = np.add.outer((q[1] * ys + q[2]).astype(np.float32), (q[0] * xs).astype(np.float32))
    window = (slice(y0, y1 + 1), slice(x0, x1 + 1))
    visible = here > canvas.inverse_depth[window]
    left, right = _spans(polygon, ys)
    columns = xs.astype(np.float32)
    visible &= columns >= left[:, None]
    visible &= columns <= right[:, None]
    if not visible.any():
        return
    texture = things.maps[cell.panel].level(*cell.level)
    h, w = texture.shape
    to_texel = np.array([[w, 0, -0.5], [0, h, -0.5], [0, 0, 1.0]]) @ cell.back @ _shift(x0, y0)
    warped = cv2.warpPerspective(
        texture,
        to_texel,
        (len(xs), len(ys)),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    mask = visible.view(np.uint8)
    cv2.copyTo(warped, mask, canvas.picture[window])
    cv2.copyTo(here, mask, canvas.inverse_depth[window])
    if canvas.gloss is not None:
        np.copyto(canvas.gloss[window], np.float32(things.gloss[cell.panel]), where=visible)


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


def _spans(polygon: list[list[float]], rows: Array) -> tuple[Shade, Shade]:
    """First and last column (real) of a convex polygon in each of successive rows; first > last off it."""
    first, count = int(rows[0]), len(rows)
    left, right = np.full(count, np.inf), np.full(count, -np.inf)
    for (x_a, y_a), (x_b, y_b) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        if abs(y_b - y_a) <= 1e-12:
            continue
        top, bottom = min(y_a, y_b) - _EDGE, max(y_a, y_b) + _EDGE
        if bottom < first or top > first + count - 1:
            continue
        met = slice(max(0, ceil(top) - first), min(count, floor(bottom) - first + 1))
        x = x_a + (rows[met] - y_a) * ((x_b - x_a) / (y_b - y_a))
        np.minimum(left[met], x, out=left[met])
        np.maximum(right[met], x, out=right[met])
    return (left - _EDGE).astype(np.float32), (right + _EDGE).astype(np.float32)


def _levels(back: Array, points: Array, texels: Array) -> Indices:
    """Levels along u and v (N, 2): at the sharpest of `points` (N, M, 2) a sample steps 1 to 2 texels."""
    x = np.concatenate([points, np.ones((*points.shape[:2], 1))], axis=2) @ back.transpose(0, 2, 1)
    q = x[..., 2:]
    step_x = (back[:, None, :2, 0] - x[..., :2] / q * back[:, None, 2:, 0]) / q
    step_y = (back[:, None, :2, 1] - x[..., :2] / q * back[:, None, 2:, 1]) / q
    step = np.hypot(step_x, step_y).min(axis=1) * texels
    return np.asarray(np.floor(np.log2(np.maximum(step, 1.0))), np.int64)

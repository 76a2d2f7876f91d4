"""Scenes: textured rectangles in metres.

World axes of every scene: x along the way, y to the left, z up; z = 0 is the floor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from collabslam.simulation import textures
from collabslam.simulation.conditions import PLAIN, Conditions
from collabslam.simulation.textures import Grey, Rng, faded, repeating
from collabslam.simulation.walls import wall
from collabslam.types import Array

Vector = Array

WIDTH, HEIGHT = 2.6, 2.6
"""Cross-section of the corridor, metres; y runs from -WIDTH / 2 to WIDTH / 2."""

_MODULE = 2.0
_TILE, _PLATE = (0.325, 0.333), (0.65, 0.5)
_SCENE_SEED = 275


@dataclass(frozen=True)
class Panel:
    """A textured rectangle (parallelogram) seen from both sides.

    Attributes
    ----------
    origin : (3,) float64
        World position, metres, of the outer corner of the texture's first texel.
    u, v : (3,) float64
        Full edges, metres, along the texture's rows (to the right) and columns (downwards).
    image : (h, w) uint8
        The texture.
    gloss : float
        Share of the scene's mirror image at the plane z = 0 that it shows: 0 dull, 1 a mirror.
    """

    origin: Vector
    u: Vector
    v: Vector
    image: Grey
    gloss: float = 0.0


def panel(origin: tuple[float, ...], u: tuple[float, ...], v: tuple[float, ...], image: Grey) -> Panel:
    """A `Panel` from plain tuples."""
    return Panel(np.array(origin, float), np.array(u, float), np.array(v, float), image)


def box(
    rng: Rng,
    centre: tuple[float, float],
    size: tuple[float, float, float],
    *,
    angle: float = 0.0,
    floor: float = 0.0,
    column: bool = False,
    face: Callable[[float, float], Grey] | None = None,
) -> list[Panel]:
    """A box standing on height `floor`: four sides and a lid, of cardboard or (`column`) of brick.

    Parameters
    ----------
    rng : Generator
        Draws the textures.
    centre : (x, y)
        Metres.
    size : (along x, along y, height)
        Metres, before it is turned by `angle` radians about the vertical.
    face : callable, optional
        Draws a side of the given width and height in place of cardboard or brick.
    """
    c, s = np.cos(angle), np.sin(angle)
    half = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * np.array(size[:2]) / 2
    corners = half @ np.array([[c, s], [-s, c]]) + np.array(centre)
    top = floor + size[2]

    def skin(width: float, height: float) -> Grey:
        if face is not None:
            return face(width, height)
        if column:
            return textures.blocks(rng, width, height, block=(0.2, 0.1), level=120.0, spread=16.0, bond=True)
        return textures.cardboard(rng, width, height)

    def corner(k: int) -> tuple[float, float, float]:
        return float(corners[k % 4, 0]), float(corners[k % 4, 1]), top

    faces = []
    for k in range(4):
        a, b = np.array(corner(k)), np.array(corner(k + 1))
        image = skin(float(np.linalg.norm(b - a)), size[2])
        faces.append(Panel(b, a - b, np.array([0.0, 0.0, -size[2]]), image))
    if not column:
        a, b, d = (np.array(corner(k)) for k in (0, 1, 3))
        faces.append(Panel(a, b - a, d - a, skin(size[1], size[0])))
    return faces


def plant(rng: Rng, centre: tuple[float, float]) -> list[Panel]:
    """A pot with a dozen of leaves that stand out at all angles."""
    panels = box(rng, centre, (0.3, 0.3, 0.35), angle=float(rng.uniform(0, 1)))
    foot = np.array([centre[0], centre[1], 0.33])
    for turn in np.linspace(0.0, 2 * np.pi, 12, endpoint=False) + rng.uniform(0, 0.4, 12):
        rise, length = rng.uniform(0.9, 1.45), rng.uniform(0.45, 0.75)
        out = np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
        side = 0.11 * np.array([-np.sin(turn), np.cos(turn), 0.0])
        panels.append(Panel(foot - side / 2, side, length * out, textures.leaf(rng, 0.11, float(length))))
    return panels


def _shell(rng: Rng, start: float, stop: float, conditions: Conditions) -> list[Panel]:
    """Walls, floor and ceiling from x = `start` to `stop`, in modules of 2 m, and both end walls."""
    w, h, m = WIDTH / 2, HEIGHT, _MODULE
    share, contrast = conditions.alike, conditions.contrast
    panels = []

    def stretch(width: float, kind: int) -> Grey:
        fitted = conditions.bare == 0.0 or bool(rng.random() >= conditions.bare)
        return faded(wall(rng, width, h, kind, fitted=fitted), contrast)

    for k, x in enumerate(np.arange(start, stop - 1e-9, m)):
        left, right = stretch(m, k), stretch(m, k + 1)
        tiles = textures.blocks(rng, WIDTH, m, block=_TILE, level=125.0, spread=17.0, bond=False)
        lamps = textures.ceiling(rng, WIDTH, m)
        tiles, lamps = (
            faded(repeating(image, block, share), contrast)
            for image, block in ((tiles, _TILE), (lamps, _PLATE))
        )
        panels += [
            panel((x, w, h), (m, 0, 0), (0, 0, -h), left),
            panel((x + m, -w, h), (-m, 0, 0), (0, 0, -h), right),
            panel((x + m, w, 0), (0, -WIDTH, 0), (-m, 0, 0), tiles),
            panel((x, w, h), (0, -WIDTH, 0), (m, 0, 0), lamps),
        ]
    panels.append(panel((stop, w, h), (0, -WIDTH, 0), (0, 0, -h), stretch(WIDTH, 0)))
    panels.append(panel((start, -w, h), (0, WIDTH, 0), (0, 0, -h), stretch(WIDTH, 1)))
    return panels


@lru_cache(maxsize=4)
def corridor(length_m: float, conditions: Conditions = PLAIN) -> tuple[Panel, ...]:
    """A straight corridor that leaves room to walk from x = 0 to `length_m`.

    It reaches from 4 m behind the start to 6 m or more past the end, is `WIDTH` wide and `HEIGHT` high,
    and has brick pillars, piles of boxes and plants along both walls, clear of the middle metre, as far as
    `conditions` leave them.
    """
    rng = np.random.Generator(np.random.PCG64(_SCENE_SEED))
    stop = -4.0 + _MODULE * np.ceil((length_m + 10.0) / _MODULE)
    panels = _shell(rng, -4.0, stop, conditions)
    present = np.random.Generator(np.random.PCG64((_SCENE_SEED, 1)))
    for k, x in enumerate(np.arange(3.0, stop - 0.8, 1.9)):
        if present.random() >= conditions.furniture:
            continue
        side = 1.0 if k % 2 else -1.0
        if k % 3 == 0:
            y = side * (WIDTH / 2 - 0.11)
            panels += box(rng, (x, y), (0.35, 0.22, HEIGHT), column=True)
        elif k % 3 == 1:
            size = (
                float(rng.uniform(0.4, 0.6)),
                float(rng.uniform(0.35, 0.45)),
                float(rng.uniform(0.35, 0.6)),
            )
            y = side * (WIDTH / 2 - 0.32)
            panels += box(rng, (x, y), size, angle=float(rng.uniform(-0.2, 0.2)))
            panels += box(rng, (x, y), (0.32, 0.28, 0.3), angle=float(rng.uniform(-0.4, 0.4)), floor=size[2])
        else:
            panels += plant(rng, (x, side * (WIDTH / 2 - 0.25)))
    return tuple(panels)

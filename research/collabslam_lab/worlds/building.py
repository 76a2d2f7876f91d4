"""A building around a way: corridors as textured panels for the cameras, and as a floor plan for lasers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from collabslam.simulation import textures
from collabslam.simulation.textures import Grey, Rng, faded, repeating
from collabslam.simulation.walls import wall
from collabslam.simulation.world import HEIGHT, Panel, Vector, box, panel, plant
from collabslam.types import Array
from collabslam_lab.worlds.route import CELL, Cell

GLOSS = 0.35
"""Share of the mirror image that a reflective floor shows."""
DIM = (1.0, 0.75, 0.5)
"""Light of a stretch of corridor where some lamps are out, as a share."""

_CLEARANCE = 0.30
_TILE, _PLATE = (0.325, 0.325), (0.65, 0.5)
_KINDS = {"doors": (0, 0, 3), "posters": (1, 4, 7), "mixed": (0, 1, 2, 4, 5, 7), "repeated": (3,)}


@dataclass(frozen=True)
class Style:
    """What a building looks like.

    Attributes
    ----------
    walls : {"mixed", "doors", "posters", "repeated"}
        What the walls carry; "repeated" makes every stretch of brick with a door the same.
    reflective : bool
        Whether the floor shines.
    dim : bool
        Whether some lamps are out.
    furniture : float
        Chance that a stretch of wall has a piece of furniture before it.
    bare : float
        Share of the stretches of wall that carry nothing.
    contrast : float
        Of walls, floor and ceiling: share of the textures' differences of brightness that is left.
    alike : float
        How much one tile of floor or ceiling is like the other: 0 each its own, 1 all the same.
    """

    walls: str = "mixed"
    reflective: bool = False
    dim: bool = False
    furniture: float = 0.5
    bare: float = 0.25
    contrast: float = 1.0
    alike: float = 0.0


@dataclass(frozen=True)
class Building:
    """Attributes
    ----------
    panels : tuple of Panel
        What the cameras see.
    plan : (N, 2, 2) float64
        Segments that a laser close above the floor meets, metres: walls and furniture.
    """

    panels: tuple[Panel, ...]
    plan: Array


def build(rng: Rng, cells: list[Cell], style: Style, tracks: Array) -> Building:
    """The corridors of some cells.

    Parameters
    ----------
    rng : Generator
        Draws everything that the style leaves open.
    cells : list of Cell
    style : Style
    tracks : (N, 2) float64
        Where robot and person go; furniture stays clear of it.
    """
    open_cells, panels, plan = set(cells), list[Panel](), list[Array]()
    stretch = _stretches(rng, style)
    for cell in cells:
        light = float(rng.choice(DIM)) if style.dim else 1.0
        corner = np.array([cell[0] * CELL, (cell[1] - 0.5) * CELL])
        faces = _level(rng, corner, style)
        for dx, dy in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            if (cell[0] + dx, cell[1] + dy) in open_cells:
                continue
            start, edge = _side(corner, dx, dy)
            faces.append(Panel(start, edge, np.array([0.0, 0.0, -HEIGHT]), stretch()))
            plan.append(np.array([start[:2], start[:2] + edge[:2]]))
            if rng.random() < style.furniture:
                piece, outline = _furniture(rng, start, edge, np.array([dx, dy]), tracks)
                faces += piece
                plan += outline
        panels += [_lit(face, light) for face in faces]
    return Building(tuple(panels), np.array(plan).reshape(-1, 2, 2))


def _stretches(rng: Rng, style: Style) -> Callable[[], Grey]:
    """Draws one stretch of wall after the other."""
    kinds = _KINDS[style.walls]
    if style.walls == "repeated":
        same = faded(wall(rng, CELL, HEIGHT, kinds[0]), style.contrast)
        return lambda: same

    def draw() -> Grey:
        return wall(rng, CELL, HEIGHT, int(rng.choice(kinds)), fitted=bool(rng.random() >= style.bare))

    return lambda: faded(draw(), style.contrast)


def _side(corner: Array, dx: int, dy: int) -> tuple[Vector, Vector]:
    """Upper left corner and upper edge of a cell's wall, as seen from inside."""
    middle = corner + CELL / 2.0 + CELL / 2.0 * np.array([dx, dy])
    right = np.array([dy, -dx])
    start = middle - CELL / 2.0 * right
    return np.array([*start, HEIGHT]), np.array([*(CELL * right), 0.0])


def _level(rng: Rng, corner: Array, style: Style) -> list[Panel]:
    """Floor and ceiling of a cell."""
    x, y = float(corner[0]), float(corner[1])
    tiles = textures.blocks(rng, CELL, CELL, block=_TILE, level=125.0, spread=17.0, bond=False)
    tiles = faded(repeating(tiles, _TILE, style.alike), style.contrast)
    floor = panel((x + CELL, y + CELL, 0.0), (0, -CELL, 0), (-CELL, 0, 0), tiles)
    if style.reflective:
        floor = Panel(floor.origin, floor.u, floor.v, floor.image, GLOSS)
    lamps = faded(repeating(textures.ceiling(rng, CELL, CELL), _PLATE, style.alike), style.contrast)
    return [floor, panel((x, y + CELL, HEIGHT), (0, -CELL, 0), (CELL, 0, 0), lamps)]


def _furniture(
    rng: Rng, start: Vector, edge: Vector, out: Array, tracks: Array
) -> tuple[list[Panel], list[Array]]:
    """A pillar, a pile of boxes or a plant before a wall, unless it would be in the way."""
    kind, turn = int(rng.integers(3)), float(np.arctan2(edge[1], edge[0]))
    size = [(0.35, 0.22), (float(rng.uniform(0.4, 0.6)), float(rng.uniform(0.35, 0.45))), (0.3, 0.3)][kind]
    off = (size[1] / 2.0, 0.32, 0.25)[kind]
    at = start[:2] + float(rng.uniform(0.15, 0.85)) * edge[:2] - off * out
    reach = 0.5 * float(np.hypot(*size))
    if np.linalg.norm(tracks - at, axis=1).min() < reach + _CLEARANCE:
        return [], []
    place = (float(at[0]), float(at[1]))
    if kind == 0:
        faces = box(rng, place, (*size, HEIGHT), angle=turn, column=True)
    elif kind == 1:
        height = float(rng.uniform(0.35, 0.6))
        faces = box(rng, place, (*size, height), angle=turn + float(rng.uniform(-0.2, 0.2)))
        faces += box(rng, place, (0.32, 0.28, 0.3), angle=turn + float(rng.uniform(-0.4, 0.4)), floor=height)
    else:
        faces = plant(rng, place)
    corners = [face.origin[:2] for face in faces[:4]]
    outline = [np.array([a, b]) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
    return faces, outline


def _lit(face: Panel, light: float) -> Panel:
    if light == 1.0:
        return face
    return Panel(face.origin, face.u, face.v, textures.grey(light * face.image), face.gloss)

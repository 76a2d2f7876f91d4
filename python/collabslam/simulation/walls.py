"""Stretches of corridor wall: plaster or brick, with doors, posters and notice boards."""

from __future__ import annotations

from collections.abc import Callable

from collabslam.simulation.textures import (
    Grey,
    Rng,
    blocks,
    door,
    grain,
    grey,
    notice_board,
    page,
    place,
    plaster,
    poster,
    texels,
)


def _dado(rng: Rng, image: Grey, height: float) -> None:
    """Paint the lower metre of a wall darker, with a rail above it and a skirting board below, in place."""
    rail, skirting = texels(height - 1.0), texels(height - 0.12)
    image[rail:] = grey(image[rail:] * float(rng.choice([0.62, 0.7])))
    image[rail - 14 : rail + 14] = grey(100.0 + 8.0 * grain(rng, 28, image.shape[1]))
    image[skirting:] = grey(60.0 + 8.0 * grain(rng, image.shape[0] - skirting, image.shape[1]))


def _with_door(rng: Rng, image: Grey, width: float, height: float) -> None:
    place(image, door(rng), 0.15, height - 2.08)
    place(image, poster(rng, 0.5, 0.7), 1.3, height - 1.95)
    place(image, page(rng, 0.22, 0.3), 1.35, height - 0.75)


def _with_posters(rng: Rng, image: Grey, width: float, height: float) -> None:
    for x in (0.08, 0.76, 1.4):
        place(
            image,
            poster(rng, rng.uniform(0.4, 0.55), rng.uniform(0.5, 0.8)),
            x,
            height - rng.uniform(1.75, 2.1),
        )
    for x in (0.2, 0.9, 1.5):
        place(image, page(rng, 0.22, 0.3), x + rng.uniform(0, 0.25), height - rng.uniform(0.5, 0.9))


def _with_board(rng: Rng, image: Grey, width: float, height: float) -> None:
    place(image, notice_board(rng, 1.4, 0.95), rng.uniform(0.1, 0.5), height - 1.9)
    place(image, poster(rng, 0.6, 0.42), rng.uniform(0.1, 1.2), height - 0.7)


FITTINGS: tuple[Callable[[Rng, Grey, float, float], None], ...] = (_with_door, _with_posters, _with_board)
"""What a stretch of wall carries, in turn."""


def wall(rng: Rng, width: float, height: float, kind: int, *, fitted: bool = True) -> Grey:
    """A stretch of wall 2 m wide or more: plaster with a dado or brick, and fittings, by number `kind`."""
    if kind % 4 == 3:
        image = blocks(rng, width, height, block=(0.25, 0.1), level=135.0, spread=14.0, bond=True)
    else:
        image = plaster(rng, width, height, float(rng.integers(150, 190)))
        _dado(rng, image, height)
    if fitted:
        FITTINGS[kind % len(FITTINGS)](rng, image, width, height)
    return image

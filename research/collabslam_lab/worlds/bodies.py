"""What moves: the person whom Cs may see, and the robot that Cf may see. Bodies face +x, z is up, metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam.simulation import textures
from collabslam.simulation.renderer import Mover, Renderer
from collabslam.simulation.textures import Grey, Rng
from collabslam.simulation.world import box
from collabslam.types import Array

HIP = 0.86
"""Height of the joints on which the legs swing, metres."""
HIP_SIDE = 0.10
"""Distance of each from the middle, metres."""
SHIN = 0.3
"""Height at which a laser sees the legs, metres."""


@dataclass(frozen=True)
class Person:
    """Trunk and head in one piece, and a leg that serves for both."""

    trunk: Renderer
    leg: Renderer

    @classmethod
    def drawn(cls, rng: Rng, scale: float) -> Person:
        """A person in a chequered shirt, `scale` samples a pixel."""
        shirt = box(rng, (0, 0), (0.24, 0.44, 0.6), floor=HIP, face=lambda w, h: _chequered(rng, w, h))
        head = box(rng, (0, 0), (0.2, 0.17, 0.25), floor=1.5, face=lambda w, h: _plain(rng, w, h, 140.0))
        leg = box(rng, (0, 0), (0.15, 0.15, HIP), floor=-HIP, face=lambda w, h: _plain(rng, w, h, 60.0))
        return cls(Renderer([*shirt, *head], scale=scale), Renderer(leg, scale=scale))

    def movers(self, place: Array, heading: float, shins: Array) -> list[Mover]:
        """The parts of somebody whose trunk is at `place` (2,), with both shins (2, 2) at `SHIN`'s height."""
        body = upright(place, heading)
        sides = (HIP_SIDE, -HIP_SIDE)
        legs = [(self.leg, _leg(body, side, shin)) for side, shin in zip(sides, shins, strict=True)]
        return [(self.trunk, body), *legs]


def robot(rng: Rng, scale: float) -> Renderer:
    """A flat robot with a mast; its origin is on the floor below Cs."""
    hull = box(rng, (-0.2, 0), (0.5, 0.4, 0.25), floor=0.06, face=lambda w, h: _plain(rng, w, h, 90.0))
    mast = box(rng, (-0.12, 0), (0.06, 0.06, 0.58), floor=0.31, face=lambda w, h: _plain(rng, w, h, 180.0))
    return Renderer([*hull, *mast], scale=scale)


def upright(place: Array, heading: float) -> Array:
    """(4, 4): a body that stands on the floor at `place` (2,) and faces `heading`."""
    c, s = np.cos(heading), np.sin(heading)
    pose = np.eye(4)
    pose[:2, :2] = [[c, -s], [s, c]]
    pose[:2, 3] = place
    return pose


def _leg(body: Array, side: float, shin: Array) -> Array:
    """(4, 4): a leg from its hip, `side` metres to the left, down through its shin."""
    hip = body[:3, :3] @ np.array([0.0, side, HIP]) + body[:3, 3]
    up = hip - np.array([shin[0], shin[1], SHIN])
    up /= np.linalg.norm(up)
    left = np.cross(up, body[:3, 0])
    left /= np.linalg.norm(left)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(left, up), left, up], axis=1)
    pose[:3, 3] = hip
    return pose


def _plain(rng: Rng, width: float, height: float, level: float) -> Grey:
    return textures.plaster(rng, width, height, level, marks=25.0)


def _chequered(rng: Rng, width: float, height: float) -> Grey:
    return textures.blocks(rng, width, height, block=(0.07, 0.07), level=130.0, spread=30.0, bond=False)

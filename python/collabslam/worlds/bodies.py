"""What moves: the person whom Cs may see, and the robot that Cf may see. Bodies face +x, z is up, metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam.demo import textures
from collabslam.demo.renderer import Mover, Renderer
from collabslam.demo.textures import Grey, Rng
from collabslam.demo.world import box
from collabslam.types import Array

HIP = 0.86
"""Height of the joints on which the legs swing, metres."""
HIP_SIDE = 0.10
"""Distance of each from the middle, metres."""


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

    def movers(self, body: Array, swing: float) -> list[Mover]:
        """The parts, where `body` (4, 4) stands in the world and the left leg is `swing` radians ahead."""
        legs = [(self.leg, body @ _leg(side, swing)) for side in (1.0, -1.0)]
        return [(self.trunk, body), *legs]


def robot(rng: Rng, scale: float) -> Renderer:
    """A flat robot with a mast; its origin is on the floor below Cs."""
    hull = box(rng, (-0.2, 0), (0.5, 0.4, 0.25), floor=0.06, face=lambda w, h: _plain(rng, w, h, 90.0))
    mast = box(rng, (-0.12, 0), (0.06, 0.06, 0.58), floor=0.31, face=lambda w, h: _plain(rng, w, h, 180.0))
    return Renderer([*hull, *mast], scale=scale)


def leg_places(body: Array, swing: float, height: float) -> Array:
    """(2, 2) metres: where the legs' axes cross a plane at `height` above the floor, left one first."""
    reach = (HIP - height) * np.tan(swing)
    local = np.array([[reach, HIP_SIDE, 0.0], [-reach, -HIP_SIDE, 0.0]])
    return np.asarray((local @ body[:3, :3].T + body[:3, 3])[:, :2])


def _leg(side: float, swing: float) -> Array:
    c, s = np.cos(side * swing), np.sin(side * swing)
    pose = np.eye(4)
    pose[:3, :3] = [[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]
    pose[:3, 3] = [0.0, side * HIP_SIDE, HIP]
    return pose


def _plain(rng: Rng, width: float, height: float, level: float) -> Grey:
    return textures.plaster(rng, width, height, level, marks=25.0)


def _chequered(rng: Rng, width: float, height: float) -> Grey:
    return textures.blocks(rng, width, height, block=(0.07, 0.07), level=130.0, spread=30.0, bond=False)

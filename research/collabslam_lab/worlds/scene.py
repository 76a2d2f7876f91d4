"""What a recipe says without a seed: who moves where, in which building, and what each camera would see.

One process makes a scene once, whoever asks: recordings of a recipe with other seeds of noise share it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np

from collabslam._core import Camera
from collabslam.simulation import textures
from collabslam.simulation.renderer import Mover, Renderer, Shutter
from collabslam.simulation.world import Panel, panel
from collabslam.types import Array, Image
from collabslam_lab.worlds.bodies import Person, robot
from collabslam_lab.worlds.building import Building, build
from collabslam_lab.worlds.catalogue import BOARD, Recipe
from collabslam_lab.worlds.motion import Drive, Walk
from collabslam_lab.worlds.passers import ASIDE, Passer, passers
from collabslam_lab.worlds.route import Route

LANE = 0.35
"""Metres between the robot's lane and the middle of the corridor; the person has the other side."""
SCALE = 1.5
"""Samples per pixel along each axis."""
LEAD = 0.6
"""Stamp of the first frame, seconds: robot and person stand still before, while other sensors run already."""

_BOARD_HEIGHT = 1.25


class Scene:
    """Motion, building and pictures free of noise.

    Parameters
    ----------
    recipe : Recipe
    """

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe
        route = Route(recipe.route)
        length = route.length if recipe.length is None else recipe.length
        self.drive = Drive(route, recipe.speed, -recipe.side * LANE, length, recipe.seed, recipe.shake)
        stations = tuple((share, ahead, recipe.side * left) for share, ahead, left in recipe.stations)
        self.walk = Walk(self.drive, stations, recipe.along, recipe.seed)
        self.passers = passers(self.drive, recipe.passers, -recipe.side * ASIDE, recipe.seed)
        self._kept: dict[tuple[int, float], Image] = {}

    def robot(self, t: float) -> Array:
        """True T_WC (4, 4) at the stamp `t`, seconds."""
        return self.drive.camera(max(t - LEAD, 0.0))

    def person(self, t: float) -> Array:
        """True T_WF (4, 4) at the stamp `t`, seconds."""
        return self.walk.camera(max(t - LEAD, 0.0))

    def shins(self, t: float) -> Array:
        """(2 + 2 N, 3): x, y and radius of shins in the lasers' plane at the stamp `t`, metres: the person's,
        then those of everybody who walks past."""
        now = max(t - LEAD, 0.0)
        return np.concatenate([self.walk.walker.legs(now), *(p.legs(now) for p in self._near(now))])

    @cached_property
    def building(self) -> Building:
        """The scene's panels, and its floor plan."""
        moments = np.arange(0.0, self.drive.duration + 0.1, 0.1)
        places = [self.drive.base(t)[:2, 3] for t in moments] + [self.walk.walker.trunk(t) for t in moments]
        for passer in self.passers:
            places += [passer.trunk(t) for t in moments if passer.there(t)]
        built = build(self._scene(0), self.drive.route.cells, self.recipe.style, np.array(places))
        at = self.recipe.board
        return built if at is None else replace(built, panels=(*built.panels, _board(at)))

    @cached_property
    def renderer(self) -> Renderer:
        """Of the scene."""
        return Renderer(self.building.panels, scale=SCALE)

    @cached_property
    def _person(self) -> Person:
        return Person.drawn(self._scene(1), SCALE)

    @cached_property
    def _strangers(self) -> dict[Passer, Person]:
        return {p: Person.drawn(self._scene(30 + k), SCALE) for k, p in enumerate(self.passers)}

    def _near(self, now: float) -> list[Passer]:
        return [p for p in self.passers if p.there(now)]

    @cached_property
    def _robot(self) -> Renderer:
        return robot(self._scene(2), SCALE)

    def _scene(self, part: int) -> np.random.Generator:
        return np.random.Generator(np.random.PCG64((self.recipe.seed, 10 + part)))

    def picture(self, which: int, t: float, camera: Camera, *, keep: bool = False) -> Image:
        """What Cs (0) or Cf (1) would see at the stamp `t`, seconds, if it had no noise: (H, W) uint8.

        With `keep` it stays in memory, for another seed's recording.
        """
        kept = self._kept.get((which, t))
        if kept is not None:
            return kept
        path: Callable[[float], Array] = (self.robot, self.person)[which]
        shutter = Shutter.along(path, t, self.recipe.exposure, self.recipe.readout)
        picture = self.renderer.render(path(t), camera, self._movers(which, t), shutter)
        if keep:
            self._kept[which, t] = picture
        return picture

    def _movers(self, which: int, t: float) -> list[Mover]:
        """Whom the camera may see: Cs the person, Cf the robot, both everybody who walks past."""
        now = max(t - LEAD, 0.0)
        out: list[Mover] = []
        for p in self._near(now):
            out += self._strangers[p].movers(p.trunk(now), p.heading(now), p.legs(now)[:, :2])
        if which == 1:
            return [*out, (self._robot, self.drive.base(now))]
        place, heading, walker = self.walk.walker.trunk(now), self.walk.heading(now), self.walk.walker
        return [*out, *self._person.movers(place, heading, walker.legs(now)[:, :2])]


def _board(at: float) -> Panel:
    """A checkerboard that hangs across the way, ``at`` metres along it."""
    image = textures.checkerboard(BOARD.columns, BOARD.rows, BOARD.square)
    width, height = ((n + 2) * BOARD.square for n in (BOARD.columns, BOARD.rows))
    corner = (at, 0.5 * width, _BOARD_HEIGHT + 0.5 * height)
    return panel(corner, (0.0, -width, 0.0), (0.0, 0.0, -height), image)


@lru_cache(maxsize=2)
def scene_of(recipe: Recipe) -> Scene:
    """The scene of a recipe; the last two are kept: a way, and its person's walk towards a board."""
    return Scene(recipe)

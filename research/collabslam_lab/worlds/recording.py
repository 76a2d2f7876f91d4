"""A recipe as a recording: rendered when its frames are asked for.

The seed governs the noise of the pictures and of the measured pose of Cf; scene and motion are the recipe's.
Each frame has its own generator, so that frames may be asked for in any order.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from collabslam._core import Camera
from collabslam.demo import textures
from collabslam.demo.exposure import ExposureControl
from collabslam.demo.recording import measured_pose
from collabslam.demo.rendered import RenderedRecording
from collabslam.demo.renderer import Mover, Renderer, Shutter
from collabslam.demo.world import Panel, panel
from collabslam.errors import InputError
from collabslam.geometry import rounded_covariance
from collabslam.types import Array, Frame, Image, WornView
from collabslam_lab.worlds.bodies import Person, robot
from collabslam_lab.worlds.building import Building, build
from collabslam_lab.worlds.catalogue import BOARD, Recipe
from collabslam_lab.worlds.life import recipe
from collabslam_lab.worlds.motion import Drive, Walk
from collabslam_lab.worlds.passers import ASIDE, Passer, passers
from collabslam_lab.worlds.route import Route

ROBOT_CAMERA = (720, 480, (781.0, 780.0, 361.5, 238.0), (-0.08, 0.06, 0.0005, -0.0004))
WORN_CAMERA = (720, 480, (777.0, 778.0, 357.0, 241.5), (-0.07, 0.05, -0.0004, 0.0006))
"""(width, height, intrinsics, distortion) of Cs and Cf: 58 degrees along the diagonal, as a Logitech C170."""
RATE = 10.0
"""Frames per second."""
LANE = 0.35
"""Metres between the robot's lane and the middle of the corridor; the person has the other side."""
SCALE = 1.5
"""Samples per pixel along each axis."""
LEAD = 0.6
"""Stamp of the first frame, seconds: robot and person stand still before, while other sensors run already."""

_BOARD_HEIGHT = 1.25


class WorldRecording(RenderedRecording):
    """A recording of two cameras in a rendered building.

    Parameters
    ----------
    recipe : Recipe
    seed : int
        Of the noise; not negative.
    """

    def __init__(self, recipe: Recipe, seed: int = 0) -> None:
        if seed < 0:
            raise InputError(f"seed is {seed}; give a number that is not negative.")
        self.recipe = recipe
        route = Route(recipe.route)
        length = route.length if recipe.length is None else recipe.length
        self.drive = Drive(route, recipe.speed, -recipe.side * LANE, length, recipe.seed, recipe.shake)
        stations = tuple((share, ahead, recipe.side * left) for share, ahead, left in recipe.stations)
        self.walk = Walk(self.drive, stations, recipe.along, recipe.seed)
        self.passers = passers(self.drive, recipe.passers, -recipe.side * ASIDE, recipe.seed)
        count = int(self.drive.duration * RATE) + 1
        times = np.round(LEAD + np.arange(count) / RATE, 9)  # whole nanoseconds, as files hold them
        self._seed = seed
        cameras = (Camera("radtan", *ROBOT_CAMERA), Camera("radtan", *WORN_CAMERA))
        truth = np.stack([self.robot(float(t)) for t in times])
        super().__init__(recipe.name, f"world:{recipe.name}", *cameras, times, truth, recipe.sensor)

    def robot(self, t: float) -> Array:
        """True T_WC (4, 4) at the stamp `t`, seconds."""
        return self.drive.camera(max(t - LEAD, 0.0))

    def person(self, t: float) -> Array:
        """True T_WF (4, 4) at the stamp `t`, seconds."""
        return self.walk.camera(max(t - LEAD, 0.0))

    def worn_picture(self, t: float, generator: np.random.Generator) -> Image:
        """What Cf sees at the stamp `t`, with noise."""
        return self._expose(1, t + self.recipe.shutter_lag, generator)

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

    def _noise(self, i: int) -> list[np.random.Generator]:
        return np.random.Generator(np.random.PCG64((self._seed, self.recipe.seed, i))).spawn(3)

    def _take_robot_image(self, i: int) -> Image:
        return self._expose(0, float(self.times[i]), self._noise(i)[0])

    def _take_frame(self, i: int) -> Frame:
        t = float(self.times[i])
        _, of_image, of_pose = self._noise(i)
        t_cf, covariance = measured_pose(self.true_t_cf(i), of_pose)
        image = self.worn_picture(t, of_image)
        return Frame(i, t, self.image(i), WornView(image, t_cf, rounded_covariance(covariance)))

    def _expose(self, which: int, t: float, generator: np.random.Generator) -> Image:
        """What Cs (0) or Cf (1) delivers at time `t`, with noise."""
        path = (self.robot, self.person)[which]
        camera = (self.camera, self.worn_camera)[which]
        shutter = Shutter.along(path, t, self.recipe.exposure, self.recipe.readout)
        clean = self.renderer.render(path(t), camera, self._movers(which, t), shutter)
        return self._sensed(clean, which, self._light[which].at(t), generator)

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

    @cached_property
    def _light(self) -> list[ExposureControl]:
        """Of Cs and of Cf."""
        recipe, seconds = self.recipe, self.drive.duration
        return [
            ExposureControl(recipe.seed, k, seconds, light=recipe.light, step=recipe.exposure_step)
            for k in (0, 1)
        ]


def _board(at: float) -> Panel:
    """A checkerboard that hangs across the way, ``at`` metres along it."""
    image = textures.checkerboard(BOARD.columns, BOARD.rows, BOARD.square)
    width, height = ((n + 2) * BOARD.square for n in (BOARD.columns, BOARD.rows))
    corner = (at, 0.5 * width, _BOARD_HEIGHT + 0.5 * height)
    return panel(corner, (0.0, -width, 0.0), (0.0, 0.0, -height), image)


def world_recording(name: str, seed: int = 0) -> WorldRecording:
    """The recording of a recipe's name.

    Parameters
    ----------
    name : str
        As for `collabslam_lab.worlds.life.recipe`.
    seed : int
        Of the noise; not negative.

    Raises
    ------
    InputError
        If there is no such recipe, or the seed is negative.
    """
    return WorldRecording(recipe(name), seed)

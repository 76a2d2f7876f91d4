"""A recipe as a recording: rendered when its frames are asked for.

The seed governs the noise of the pictures and of the measured pose of Cf; scene and motion are the recipe's.
Each frame has its own generator, so that frames may be asked for in any order.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from collabslam._core import Camera
from collabslam.errors import InputError
from collabslam.geometry import rounded_covariance
from collabslam.simulation.exposure import ExposureControl
from collabslam.simulation.recording import measured_pose
from collabslam.simulation.rendered import RenderedRecording
from collabslam.types import Array, Frame, Image
from collabslam_lab.worlds.building import Building
from collabslam_lab.worlds.catalogue import Recipe
from collabslam_lab.worlds.life import recipe
from collabslam_lab.worlds.scene import LEAD, scene_of

ROBOT_CAMERA = (720, 480, (781.0, 780.0, 361.5, 238.0), (-0.08, 0.06, 0.0005, -0.0004))
WORN_CAMERA = (720, 480, (777.0, 778.0, 357.0, 241.5), (-0.07, 0.05, -0.0004, 0.0006))
"""(width, height, intrinsics, distortion) of Cs and Cf: 58 degrees along the diagonal, as a Logitech C170."""
RATE = 10.0
"""Frames per second."""


class WorldRecording(RenderedRecording):
    """A recording of two cameras in a rendered building.

    Parameters
    ----------
    recipe : Recipe
    seed : int
        Of the noise; not negative.
    keep : bool
        Whether pictures free of noise stay in memory (0.35 MB each), for another seed in the same process.

    Attributes
    ----------
    recipe : Recipe
    scene : Scene
        What has no noise.
    """

    body = True

    def __init__(self, recipe: Recipe, seed: int = 0, *, keep: bool = False) -> None:
        if seed < 0:
            raise InputError(f"seed is {seed}; give a number that is not negative.")
        self.recipe = recipe
        self.scene, self._keep = scene_of(recipe), keep
        count = int(self.scene.drive.duration * RATE) + 1
        times = np.round(LEAD + np.arange(count) / RATE, 9)  # whole nanoseconds, as files hold them
        self._seed = seed
        cameras = (Camera("radtan", *ROBOT_CAMERA), Camera("radtan", *WORN_CAMERA))
        truth = np.stack([self.robot(float(t)) for t in times])
        super().__init__(recipe.name, f"world:{recipe.name}", *cameras, times, truth, recipe.sensor)

    def robot(self, t: float) -> Array:
        """True T_WC (4, 4) at the stamp `t`, seconds."""
        return self.scene.robot(t)

    def person(self, t: float) -> Array:
        """True T_WF (4, 4) at the stamp `t`, seconds."""
        return self.scene.person(t)

    def shins(self, t: float) -> Array:
        """As of `Scene.shins`."""
        return self.scene.shins(t)

    @property
    def building(self) -> Building:
        """As of `Scene.building`."""
        return self.scene.building

    def worn_picture(self, t: float, generator: np.random.Generator) -> Image:
        """What Cf sees at the stamp `t`, with noise."""
        return self._expose(1, t + self.recipe.shutter_lag, generator)

    def _noise(self, i: int) -> list[np.random.Generator]:
        return np.random.Generator(np.random.PCG64((self._seed, self.recipe.seed, i))).spawn(3)

    def _take_robot_image(self, i: int) -> Image:
        return self._expose(0, float(self.times[i]), self._noise(i)[0])

    def _take_frame(self, i: int) -> Frame:
        t = float(self.times[i])
        _, of_image, of_pose = self._noise(i)
        t_cf, covariance = measured_pose(self.true_t_cf(i), of_pose)
        view = self.view(self.worn_picture(t, of_image), (t_cf, rounded_covariance(covariance)))
        return Frame(i, t, self.image(i), (view,))

    def _expose(self, which: int, t: float, generator: np.random.Generator) -> Image:
        """What Cs (0) or Cf (1) delivers at time `t`, with noise."""
        clean = self.scene.picture(which, t, (self.camera, self.worn_camera)[which], keep=self._keep)
        return self._sensed(clean, which, self._light[which].at(t), generator)

    @cached_property
    def _light(self) -> list[ExposureControl]:
        """Of Cs and of Cf."""
        recipe, seconds = self.recipe, self.scene.drive.duration
        return [
            ExposureControl(recipe.seed, k, seconds, light=recipe.light, step=recipe.exposure_step)
            for k in (0, 1)
        ]


def world_recording(name: str, seed: int = 0, *, keep: bool = False) -> WorldRecording:
    """The recording of a recipe's name.

    Parameters
    ----------
    name : str
        As for `collabslam_lab.worlds.life.recipe`.
    seed, keep
        As of `WorldRecording`.

    Raises
    ------
    InputError
        If there is no such recipe, or the seed is negative.
    """
    return WorldRecording(recipe(name), seed, keep=keep)

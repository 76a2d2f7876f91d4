"""A simulated recording: a walk through a scene, seen by two cameras, with noise.

The scene and the walk are fixed. The seed governs only the noise: of the pictures, and of the measured pose
of Cf relative to Cs. Each frame has its own generator, so that frames may be asked for in any order.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from collabslam._core import Camera
from collabslam.errors import InputError
from collabslam.geometry import pose_inverse, se3_exp
from collabslam.simulation.conditions import HARD, PLAIN, Conditions
from collabslam.simulation.exposure import ExposureControl
from collabslam.simulation.rendered import RenderedRecording
from collabslam.simulation.renderer import Renderer, Shutter
from collabslam.simulation.trajectory import GLANCES, CorridorWalk
from collabslam.simulation.tremor import Tremor
from collabslam.simulation.world import corridor
from collabslam.types import Array, Frame, Image, WornView

ROBOT_CAMERA = (720, 480, (620.0, 620.0, 359.5, 239.5), (-0.06, 0.02, 0.0005, -0.0004))
WORN_CAMERA = (720, 480, (614.0, 615.0, 364.0, 236.5), (-0.05, 0.015, -0.0003, 0.0006))
"""(width, height, intrinsics, distortion) of Cs and Cf: about 60 degrees wide."""

POSITION_SD = 0.03
"""Standard deviation of the measured position of F in C along each axis, metres."""
ROTATION_SD = (0.5, 1.0, 0.5)
"""Standard deviation of the measured attitude about F's x (pitch), y (yaw) and z (roll) axes, degrees."""

DEMO_METRES = 40.0
"""Length of the demo's way."""

_MOTION_SEED = 276


class SimulatedRecording(RenderedRecording):
    """A recording of a scene and a walk; Cf's view is there where the person looks ahead.

    Parameters
    ----------
    renderer : Renderer
        The scene.
    walk : CorridorWalk
        The motion of both cameras.
    times : (N,) float64
        Time stamps, seconds.
    name : str
        Short name.
    seed : int
        Of the noise.
    conditions : Conditions
        Of the cameras.
    """

    body = False

    def __init__(
        self,
        renderer: Renderer,
        walk: CorridorWalk,
        times: Array,
        name: str,
        seed: int,
        conditions: Conditions = PLAIN,
    ) -> None:
        cameras = (Camera("radtan", *ROBOT_CAMERA), Camera("radtan", *WORN_CAMERA))
        truth = np.stack([walk.robot(float(t)) for t in times])
        super().__init__(name, f"demo:{name}", *cameras, times, truth, conditions.sensor)
        self.renderer = renderer
        self._walk = walk
        self._seed = seed
        self._conditions = conditions
        step, seconds = conditions.exposure_step, float(times[-1])
        self._light = [ExposureControl(_MOTION_SEED, k, seconds, step=step) for k in (0, 1)] if step else None

    def robot(self, t: float) -> Array:
        """True T_WC (4, 4) at the stamp `t`, seconds."""
        return self._walk.robot(t)

    def worn_picture(self, t: float, generator: np.random.Generator) -> Image:
        """What Cf sees at the stamp `t`, with noise, wherever it looks."""
        return self._expose(1, t, generator)

    def worn_picture_at(self, pose: Array, generator: np.random.Generator) -> Image:
        """What a Cf that stands still would see from a `pose` T_WF (4, 4), with noise."""
        return self._sensed(self.renderer.render(pose, self.worn_camera), 1, 1.0, generator)

    def person(self, t: float) -> Array:
        """True T_WF (4, 4) at the stamp `t`, seconds."""
        return self._walk.person(t)

    def worn_at(self, t: float, number: int) -> WornView | None:
        """What Cf sees at any time, as its view of that number: for a Cf that runs on a clock of its own."""
        if not self._walk.looks_ahead(t):
            return None
        generator = np.random.Generator(np.random.PCG64((self._seed, 1, number)))
        measured = measured_pose(pose_inverse(self.robot(t)) @ self.person(t), generator)
        return self.view(self._expose(1, t, generator.spawn(2)[1]), measured, t)

    def _noise(self, i: int) -> np.random.Generator:
        return np.random.Generator(np.random.PCG64((self._seed, i)))

    def _take_robot_image(self, i: int) -> Image:
        return self._expose(0, float(self.times[i]), self._noise(i).spawn(2)[0])

    def _take_frame(self, i: int) -> Frame:
        t = float(self.times[i])
        views: tuple[WornView, ...] = ()
        if self._walk.looks_ahead(t):
            generator = self._noise(i)
            measured = measured_pose(self.true_t_cf(i), generator)
            views = (self.view(self._expose(1, t, generator.spawn(2)[1]), measured),)
        return Frame(i, t, self.image(i), views)

    def _expose(self, which: int, t: float, generator: np.random.Generator) -> Image:
        """What Cs (0) or Cf (1) delivers at the stamp `t`: the rendered picture with vignetting and noise."""
        path, camera = (self.robot, self.person)[which], (self.camera, self.worn_camera)[which]
        exposure, readout = self._conditions.exposure, self._conditions.readout
        shutter = Shutter.along(path, t, exposure, readout) if exposure else None
        light = 1.0 if self._light is None else self._light[which].at(t)
        return self._sensed(self.renderer.render(path(t), camera, shutter=shutter), which, light, generator)


def measured_pose(
    true: Array,
    generator: np.random.Generator,
    position_sd: float = POSITION_SD,
    rotation_sd: tuple[float, float, float] = ROTATION_SD,
) -> tuple[Array, Array]:
    """A measured T_CF (4, 4) with white noise, and its covariance (6, 6), tangent on the right.

    Standard deviations are of the position along each axis, metres, and about F's axes, degrees.
    """
    return pose_with_error(true, generator.standard_normal(6), position_sd, rotation_sd)


def pose_with_error(
    true: Array,
    error: Array,
    position_sd: float = POSITION_SD,
    rotation_sd: tuple[float, float, float] = ROTATION_SD,
) -> tuple[Array, Array]:
    """As `measured_pose`, with this error (6,) in standard deviations."""
    sd = np.concatenate([np.full(3, position_sd), np.deg2rad(rotation_sd)])
    error = se3_exp(sd * error)
    measured = np.eye(4)
    measured[:3, :3] = true[:3, :3] @ error[:3, :3].T
    measured[:3, 3] = true[:3, 3] - measured[:3, :3] @ error[:3, 3]
    return measured, np.diag(sd**2)


def corridor_recording(
    seed: int = 0,
    *,
    length_m: float = 15.0,
    speed: float = 1.5,
    rate: float = 10.0,
    glances: Sequence[tuple[float, float]] = GLANCES,
    conditions: Conditions = PLAIN,
) -> SimulatedRecording:
    """A robot and a person go down a straight corridor together.

    Parameters
    ----------
    seed : int
        Of the noise of the pictures and of T_CF; not negative. The scene and the paths do not depend on it.
    length_m : float
        Length of the way, metres, at most 200.
    speed : float
        Mean speed, m/s.
    rate : float
        Frames per second.
    glances : sequence of (start, stop)
        When, within each 10.5 s, the person looks ahead, seconds; (0, infinity) is all the time.
    conditions : Conditions
        How hard the world is to see and to drive.

    Returns
    -------
    SimulatedRecording
        Cf's view is there in about 40 % of the frames with the demo's own glances, from the first one on.

    Raises
    ------
    InputError
        If a value is not positive and finite, the way is too long, or there would be less than two frames.
    """
    for name, value in (("length_m", length_m), ("speed", speed), ("rate", rate)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name} is {value}; give a positive number.")
    if length_m > 200.0:
        raise InputError(f"length_m is {length_m}; give at most 200 metres.")
    if seed < 0:
        raise InputError(f"seed is {seed}; give a number that is not negative.")
    count = round(length_m / speed * rate)
    if count < 2:
        raise InputError(f"A way of {length_m} m makes {count} frames; give a longer way or a higher rate.")
    times = np.arange(count) / rate
    tremor = None
    if conditions.shake != (0.0, 0.0):
        tremor = Tremor(np.random.Generator(np.random.PCG64((_MOTION_SEED, 5))), *conditions.shake)
    walk = CorridorWalk(speed, glances=glances, tremor=tremor)
    renderer = _corridor_renderer(length_m, conditions)
    return SimulatedRecording(renderer, walk, times, "corridor", seed, conditions)


def demo_recording(seed: int = 0) -> SimulatedRecording:
    """What `collabslam demo` runs: `DEMO_METRES` of a corridor as hard as recordings are.

    Parameters
    ----------
    seed : int
        Of the noise of the pictures and of T_CF; not negative.

    Raises
    ------
    InputError
        If the seed is negative.
    """
    return corridor_recording(seed, length_m=DEMO_METRES, conditions=HARD)


@lru_cache(maxsize=2)
def _corridor_renderer(length_m: float, conditions: Conditions) -> Renderer:
    """One renderer a scene: its reduced textures serve every recording."""
    return Renderer(corridor(length_m, conditions))

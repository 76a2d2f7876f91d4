"""Rendered ways on which Cf's clock is not that of Cs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from collabslam.datasets.wrapped import FirstFrames, WrappedRecording
from collabslam.geometry import pose_inverse
from collabslam.simulation import SimulatedRecording, corridor_recording
from collabslam.simulation.held import HeldRecording
from collabslam.simulation.recording import POSITION_SD, ROTATION_SD, measured_pose
from collabslam.types import Frame, Image
from collabslam_lab.calibrated.trajectories import rendered
from collabslam_lab.worlds import WorldRecording, world_recording

Noise = tuple[float, tuple[float, float, float]]
"""Standard deviations of a measured T_CF: along each axis, metres, and about F's axes, degrees."""

CORRIDOR, LIVELY = "corridor", "lively"
LIVELY_FRAMES = 80
KNOWN: dict[str, Noise] = {
    "3 cm, 1 degree": (POSITION_SD, ROTATION_SD),
    "5 mm, 0.2 degrees": (0.005, (0.2, 0.2, 0.2)),
}
AHEAD = ((0.0, np.inf),)
"""Glances of a person who looks ahead all the time."""


class SideBySide(HeldRecording):
    """A rendered way, each picture of which is drawn once for all runs.

    Parameters
    ----------
    world : SimulatedRecording or WorldRecording
    frames : int, optional
        Only so many from the first one on.
    """

    def __init__(self, world: SimulatedRecording | WorldRecording, frames: int | None = None) -> None:
        super().__init__(world if frames is None else FirstFrames(world, frames))
        self.world = world
        self.worn_picture = cache(self._worn_picture)

    def _worn_picture(self, i: int, late: float) -> Image:
        """What Cf sees ``late`` seconds after frame ``i``."""
        return self.world.worn_picture(float(self.times[i]) + late, np.random.default_rng([17, i]))


def side_by_side(way: str, seed: int, frames: int | None = None) -> SideBySide:
    """A way by its name; ``seed`` governs the noise.

    The demo's corridor, 9 m of it; 8 s in it of a Cs that turns and a Cf that goes about; or a world of the
    lab.
    """
    if way == LIVELY:
        return SideBySide(rendered(LIVELY, LIVELY_FRAMES, seed), frames)
    if way == CORRIDOR:
        return SideBySide(corridor_recording(seed, length_m=9.0, glances=AHEAD), frames)
    return SideBySide(world_recording(way, seed), frames)


class WrongStamps(WrappedRecording):
    """A way on which Cf's clock is behind: its image and ``T_CF`` are of a later instant than they say.

    Parameters
    ----------
    base : SideBySide
    seconds : float
        How much later.
    noise : Noise
        Of ``T_CF``.
    """

    def __init__(self, base: SideBySide, seconds: float, noise: Noise) -> None:
        super().__init__(base)
        self._way, self._late, self._sds = base, seconds, noise

    def frame(self, i: int) -> Frame:
        """Frame ``i``: Cs as it is, Cf of another instant."""
        world, frame = self._way.world, self._way.frame(i)
        if not frame.views:
            return frame
        t = frame.t + self._late
        true = pose_inverse(world.robot(t)) @ world.person(t)
        measured = measured_pose(true, np.random.default_rng([19, i]), *self._sds)
        worn = world.view(self._way.worn_picture(i, self._late), measured)
        return replace(frame, views=(worn,))

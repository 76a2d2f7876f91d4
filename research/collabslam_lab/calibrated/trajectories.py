"""Trajectories down the demo's corridor by motion, and recordings with a T_CF that is wrong in all views."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collabslam.datasets.poses import interpolate_track
from collabslam.datasets.worn_calibration import corrected
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.geometry import pose_inverse, se3_exp
from collabslam.simulation.recording import SimulatedRecording
from collabslam.simulation.renderer import Renderer
from collabslam.simulation.trajectory import CorridorWalk, camera_pose, waves
from collabslam.simulation.world import corridor
from collabslam.types import Array, Frame, Image, Recording

RATE = 10.0
METRES, DEGREES, SECONDS = 0.03, 1.0, 0.05
"""Of the error that all views share."""


class LivelyWalk(CorridorWalk):
    """Cs turns, speeds up and slows down; Cf goes about beside it, up and down, ahead and behind."""

    def robot(self, t: float) -> Array:
        """T_WC (4, 4)."""
        x = 1.2 * t + waves(t, [(0.35, 0.31, 0.3), (0.12, 0.83, 1.0)])
        y = -0.35 + waves(t, [(0.2, 0.23, 0.8), (0.05, 0.9, 0.1)])
        yaw = waves(t, [(0.22, 0.19, 1.0), (0.08, 0.6, 0.3)])
        pitch = waves(t, [(0.05, 0.37, 0.0), (0.02, 1.1, 1.0)])
        height = 0.95 + waves(t, [(0.03, 0.7, 0.4)])
        return camera_pose([x, y, height], yaw, pitch, waves(t, [(0.05, 0.29, 2.0)]))

    def person(self, t: float) -> Array:
        """T_WF (4, 4)."""
        x, y, _ = self.robot(t)[:3, 3]
        x += 0.1 + waves(t, [(0.45, 0.13, 0.6), (0.1, 0.7, 0.0)])
        y += 0.6 + waves(t, [(0.25, 0.21, 0.5)])
        height = 1.5 + waves(t, [(0.25, 0.17, 0.9)])
        yaw, roll = waves(t, [(0.15, 0.27, 2.6)]), waves(t, [(0.06, 0.41, 1.2)])
        return camera_pose([x, y, height], yaw, -0.1 + waves(t, [(0.06, 0.29, 0.2)]), roll)

    def looks_ahead(self, t: float) -> bool:
        """Always."""
        return True


class EvenWalk(LivelyWalk):
    """Cs goes straight at constant velocity and Cf is fixed to it: pure translation."""

    def robot(self, t: float) -> Array:
        """T_WC (4, 4)."""
        return camera_pose([1.2 * t, -0.35, 0.95], 0.0, 0.0, 0.0)

    def person(self, t: float) -> Array:
        """T_WF (4, 4)."""
        beside = camera_pose([0.2, 0.65, 0.6], 0.05, -0.08, 0.02)
        level = camera_pose([0.0, 0.0, 0.0], 0.0, 0.0, 0.0)
        return np.asarray(self.robot(t) @ pose_inverse(level) @ beside)


class BendingWalk(EvenWalk):
    """As before, but Cs turns evenly about its own vertical axis: a constant twist about one axis."""

    def robot(self, t: float) -> Array:
        """T_WC (4, 4)."""
        twist = np.array([0.0, 0.0, 0.03, 0.0, 0.012, 0.0])  # of a tenth of a second, along Cs's axes
        step, rest = divmod(10.0 * t, 1.0)
        pose = camera_pose([0.0, -0.5, 0.95], 0.6, 0.0, 0.0)
        small = se3_exp(0.01 * twist)
        return np.asarray(pose @ np.linalg.matrix_power(small, round(100.0 * (step + rest))))


WALKS: dict[str, type[CorridorWalk]] = {
    "lively": LivelyWalk,
    "even": EvenWalk,
    "one axis": BendingWalk,
}


def rendered(walk: str, frames: int, seed: int) -> SimulatedRecording:
    """A trajectory of so many frames; the seed is of the noise."""
    renderer = Renderer(corridor(1.4 * frames / RATE + 8.0))
    return SimulatedRecording(renderer, WALKS[walk](), np.arange(frames) / RATE, walk, seed)


def drawn_error(seed: int) -> tuple[Array, float]:
    """A shift of `METRES` and a turn of `DEGREES` in random directions along C's axes, (6,), and a clock."""
    draw = np.random.Generator(np.random.PCG64((seed, 26)))
    shift, turn = draw.standard_normal((2, 3))
    error = [METRES * shift / np.linalg.norm(shift), np.radians(DEGREES) * turn / np.linalg.norm(turn)]
    return np.concatenate(error), SECONDS * float(draw.choice([-1.0, 1.0]))


class Erring(WrappedRecording):
    """A recording whose measured T_CF all have the same error, and whose views were taken after their stamps.

    In a rendered recording Cf's pictures are those of the later time. In others, whose Cf is an image of a
    scene that stands still, it is T_CF alone that would have been different.

    Parameters
    ----------
    base : Recording
    error : (6,) array
        Along C's axes, metres and radians; what would correct it is its negative.
    clock : float
        Seconds after its stamp that a view was taken.
    """

    def __init__(self, base: Recording, error: Array, clock: float) -> None:
        super().__init__(base)
        self._error, self._clock = error, clock
        self._frames: dict[int, Frame] = {}

    def image(self, i: int) -> Image:
        """The image of Cs."""
        return self.frame(i).image

    def frame(self, i: int) -> Frame:
        """Frame ``i``; it is made once."""
        if i not in self._frames:
            frame = self._late(self._base.frame(i))
            views = (replace(view, t_cf=corrected(view.t_cf, self._error)) for view in frame.views)
            self._frames[i] = replace(frame, views=tuple(views))
        return self._frames[i]

    def _late(self, frame: Frame) -> Frame:
        if not frame.views or not self._clock:
            return frame
        if isinstance(self._base, SimulatedRecording):
            worn = self._base.worn_at(frame.t + self._clock, frame.index)
            return replace(frame, views=() if worn is None else (replace(worn, t=None),))
        assert self.truth is not None, "Cf was emulated by true poses"
        known = np.isfinite(self.truth).all(axis=(1, 2))
        later = interpolate_track(self.times[known], self.truth[known], np.array([frame.t + self._clock]))[0]
        if not np.isfinite(later).all():
            return replace(frame, views=())
        moved = pose_inverse(later) @ self.truth[frame.index]
        return replace(frame, views=tuple(replace(view, t_cf=moved @ view.t_cf) for view in frame.views))


class Stated(WrappedRecording):
    """A recording whose views say that T_CF may have an error of that size that lasts."""

    def image(self, i: int) -> Image:
        """The image of Cs."""
        return self._base.image(i)

    def frame(self, i: int) -> Frame:
        """Frame ``i``."""
        frame = self._base.frame(i)
        time_correlated = np.diag(np.repeat([METRES, np.radians(DEGREES)], 3) ** 2 / 3.0)
        views = (
            replace(view, covariance=view.covariance + time_correlated, bias=time_correlated)
            for view in frame.views
        )
        return replace(frame, views=tuple(views))


class Untrue(WrappedRecording):
    """A recording whose true poses nobody knows."""

    def __init__(self, base: Recording) -> None:
        super().__init__(base)
        self.truth = None

"""The walk: poses of the robot's and of the worn camera as smooth functions of time.

World axes as in `world`: x along the way, y to the left, z up, metres. Times are seconds from the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from collabslam.datasets.poses import BODY_FROM_OPTICAL
from collabslam.simulation.tremor import Tremor
from collabslam.types import Array

GLANCES = ((0.0, 1.2), (4.1, 5.2), (8.1, 8.9))
"""When the demo's person looks ahead, seconds within a period."""


def camera_pose(position: npt.ArrayLike, yaw: float, pitch: float, roll: float) -> Array:
    """T_WC (4, 4) of a camera at `position` (3,) that looks along +x, turned by three angles in radians.

    Parameters
    ----------
    yaw : float
        To the left.
    pitch : float
        Upwards.
    roll : float
        About the line of sight, the camera's right side downwards.
    """
    (cy, cp, cr), (sy, sp, sr) = np.cos([yaw, pitch, roll]), np.sin([yaw, pitch, roll])
    turn_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    turn_y = np.array([[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]])
    turn_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    pose = np.eye(4)
    pose[:3, :3] = turn_z @ turn_y @ turn_x @ BODY_FROM_OPTICAL[:3, :3]
    pose[:3, 3] = position
    return pose


def waves(t: float, parts: Sequence[tuple[float, float, float]]) -> float:
    """Sum of sines at time `t`; each part is (amplitude, frequency in Hz, phase in radians)."""
    return float(sum(a * np.sin(2.0 * np.pi * f * t + p) for a, f, p in parts))


def smooth_step(x: float) -> float:
    """0 up to x = 0, 1 from x = 1 on, with continuous second derivatives."""
    x = min(max(x, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


@dataclass(frozen=True)
class CorridorWalk:
    """A robot drives down the corridor; a person walks beside it and looks now ahead, now at the walls.

    Attributes
    ----------
    speed : float
        Mean speed of the robot, m/s.
    period : float
        Seconds after which the person's glances repeat.
    glances : sequence of (start, stop)
        When, within a period, the person looks ahead, along with the robot.
    turn_time : float
        Seconds in which the head turns.
    tremor : Tremor, optional
        What else shakes the robot's camera.
    """

    speed: float = 1.5
    period: float = 10.5
    glances: Sequence[tuple[float, float]] = GLANCES
    turn_time: float = 0.45
    tremor: Tremor | None = None

    def robot(self, t: float) -> Array:
        """T_WC (4, 4): Cs about 0.95 m above the floor, heading along the path, with the shake of driving."""
        position, heading = self._robot_on_floor(t)
        height = 0.95 + waves(t, [(0.0015, 3.1, 0.4), (0.001, 4.3, 2.0)])
        yaw = heading + waves(t, [(0.012, 0.31, 1.0), (0.0012, 3.7, 0.3)])
        pitch = waves(t, [(0.004, 0.53, 0.0), (0.0025, 2.9, 1.1), (0.0012, 4.4, 0.6)])
        roll = waves(t, [(0.003, 0.43, 2.0), (0.0018, 3.4, 0.0)])
        place = np.array([position[0], position[1], height])
        angles = np.array([yaw, pitch, roll])
        if self.tremor is not None:
            shaken = self.tremor.at(t)
            place, angles = place + shaken[:3], angles + shaken[3:]
        return camera_pose(place, *angles)

    def person(self, t: float) -> Array:
        """T_WF (4, 4): Cf 1.7 m above the floor, 0.6 to 0.8 m left of Cs, now ahead, now behind."""
        position, _ = self._robot_on_floor(t)
        x = position[0] + waves(t, [(0.3, 0.11, 0.6), (0.02, 1.9, 0.0)])
        y = position[1] + 0.7 + waves(t, [(0.08, 0.17, 0.5), (0.015, 0.95, 0.0)])
        height = 1.70 + waves(t, [(0.018, 1.9, 0.9)])
        away, side = self._look_away(t)
        yaw = side * np.deg2rad(78.0) * away + waves(t, [(0.05, 0.37, 2.6), (0.012, 0.95, 1.0)])
        pitch = np.deg2rad(-9.0 + 4.0 * away) + waves(t, [(0.025, 0.29, 0.2), (0.008, 1.9, 0.0)])
        roll = waves(t, [(0.02, 0.41, 1.2), (0.006, 0.95, 0.0)])
        return camera_pose([x, y, height], yaw, pitch, roll)

    def looks_ahead(self, t: float) -> bool:
        """Whether the person's head is turned ahead, or nearly so, at time `t`: then Cf's picture is sent."""
        return self._look_away(t)[0] < 0.2

    def _robot_on_floor(self, t: float) -> tuple[Array, float]:
        """Position (x, y) and heading: the tangent of the path."""
        w1, w2 = 2.0 * np.pi / 7.0, 2.0 * np.pi / 4.6
        x = self.speed * t + 0.04 * self.speed * np.sin(w2 * t)
        y = -0.35 + 0.09 * np.sin(w1 * t + 0.8)
        dx = self.speed * (1.0 + 0.04 * w2 * np.cos(w2 * t))
        dy = 0.09 * w1 * np.cos(w1 * t + 0.8)
        return np.array([x, y]), float(np.arctan2(dy, dx))

    def _look_away(self, t: float) -> tuple[float, float]:
        """How far the head is turned away (0 ahead, 1 at a wall) and to which side (1 left, -1 right)."""
        phase = t % self.period
        stops = [0.0] + [stop for _, stop in self.glances]
        for k, (start, stop) in enumerate([*self.glances, (self.period, self.period)]):
            if phase < start:
                out = smooth_step((phase - stops[k]) / self.turn_time)
                back = smooth_step((start - phase) / self.turn_time)
                return min(out, back), 1.0 if k % 2 else -1.0
            if phase <= stop:
                break
        return 0.0, 1.0

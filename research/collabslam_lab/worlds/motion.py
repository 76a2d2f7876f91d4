"""How the robot drives and how the person walks and looks: poses as smooth functions of time.

World axes: x along the way at the start, y to the left, z up, metres; times in seconds from the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from collabslam.simulation.trajectory import camera_pose, smooth_step, waves
from collabslam.simulation.tremor import Tremor
from collabslam.types import Array
from collabslam_lab.worlds.bodies import upright
from collabslam_lab.worlds.route import Route
from collabslam_lab.worn_sensors import Build, Walker

ROBOT_CAMERA_HEIGHT = 0.95
"""Metres above the floor."""

_START_SECONDS = 1.2
_DT = 0.002
_WALK_DT = 0.02
_ANTICIPATION = 0.4
_CHANGE_SECONDS = 3.0
_GLANCE_PERIOD = 4.2

Station = tuple[float, float, float]
"""(share of the way from which it holds, metres ahead of the robot, metres to its left)."""


def _phases(rng: np.random.Generator, count: int) -> list[float]:
    return [float(p) for p in rng.uniform(0.0, 2.0 * np.pi, count)]


@dataclass(frozen=True)
class Drive:
    """A robot that drives along a way, in a lane beside its centre line.

    Attributes
    ----------
    route : Route
    speed : float
        m/s, reached in about a second from rest.
    lane : float
        Metres to the left of the centre line.
    length : float
        Metres that the robot drives.
    seed : int
        Of its shake.
    shake : (float, float)
        What shakes it beside the driving, as uneven ground or a hand does, between 0.2 and 1.5 Hz: standard
        deviation about each axis, degrees, and along each, metres.
    """

    route: Route
    speed: float
    lane: float
    length: float
    seed: int
    shake: tuple[float, float] = (0.0, 0.0)

    @property
    def duration(self) -> float:
        """Seconds until the length is driven."""
        times, _, driven = self._progress
        return float(np.interp(self.length, driven, times))

    def progress(self, t: float) -> float:
        """Arc length of the centre line at time `t`, metres."""
        times, s, _ = self._progress
        return float(np.interp(t, times, s))

    def camera(self, t: float) -> Array:
        """T_WC (4, 4): Cs heads along the way, with the shake of driving."""
        a, b, c, d, e, f, g = self._shake
        s = self.progress(t)
        place, heading = self.route.along(s, self.lane + waves(t, [(0.03, 0.11, a)]))
        height = ROBOT_CAMERA_HEIGHT + waves(t, [(0.0015, 3.1, b), (0.001, 4.3, c)])
        yaw = float(heading) + waves(t, [(0.012, 0.31, d), (0.0012, 3.7, e)])
        pitch = waves(t, [(0.004, 0.53, f), (0.0025, 2.9, g), (0.0012, 4.4, a)])
        roll = waves(t, [(0.003, 0.43, b), (0.0018, 3.4, c)])
        if self.shake == (0.0, 0.0):
            return camera_pose([place[0], place[1], height], yaw, pitch, roll)
        x, y, z, more_yaw, more_pitch, more_roll = self._tremor.at(t)
        where = [place[0] + x, place[1] + y, height + z]
        return camera_pose(where, yaw + more_yaw, pitch + more_pitch, roll + more_roll)

    def base(self, t: float) -> Array:
        """(4, 4): the robot's body, x ahead, z up, its origin on the floor below Cs."""
        place, heading = self.route.along(self.progress(t), self.lane)
        return upright(place, float(heading))

    @cached_property
    def _tremor(self) -> Tremor:
        return Tremor(np.random.Generator(np.random.PCG64((self.seed, 5))), *self.shake)

    @cached_property
    def _shake(self) -> list[float]:
        return _phases(np.random.Generator(np.random.PCG64((self.seed, 1))), 7)

    @cached_property
    def _progress(self) -> tuple[Array, Array, Array]:
        """Times, arc length of the centre line, and way driven, every 2 ms."""
        longest = self.length / (0.9 * self.speed) + 2.0 * _START_SECONDS
        times = np.arange(0.0, longest, _DT)
        ramp = np.array([smooth_step(t / _START_SECONDS) for t in times])
        phase = self._shake[0]
        speed = self.speed * ramp * (1.0 + 0.04 * np.sin(2.0 * np.pi * 0.21 * times + phase))
        driven = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) * _DT])
        grid = np.arange(0.0, self.route.length + 4.0, 0.005)
        own = np.cumsum(1.0 - self.route.bend(grid) * self.lane) * 0.005
        return times, np.interp(driven, own - own[0], grid), driven


@dataclass(frozen=True)
class Walk:
    """A person who walks with the robot and looks now along the way, now elsewhere.

    Attributes
    ----------
    drive : Drive
    stations : sequence of Station
        Where the person walks.
    along : float
        Share of the time in which the head is meant to be along the way.
    seed : int
        Of gait, glances and sway.
    """

    drive: Drive
    stations: Sequence[Station]
    along: float
    seed: int

    @cached_property
    def walker(self) -> Walker:
        """Legs and worn camera, with the gait of somebody drawn by the seed."""
        moments = np.arange(0.0, self.drive.duration + 1.0, _WALK_DT)
        rows = [self._intent(float(t)) for t in moments]
        rng = np.random.Generator(np.random.PCG64((self.seed, 4)))
        build = Build.drawn(rng)
        return Walker(moments, np.array([r[:2] for r in rows]), np.array([r[2:] for r in rows]), build)

    def camera(self, t: float) -> Array:
        """T_WF (4, 4): Cf on the head, with the walk's bob and sway."""
        return self.walker.camera(t)

    def heading(self, t: float) -> float:
        """Of the way where the person is, radians."""
        return float(self.drive.route.along(self.drive.progress(t) + self._station(t)[0])[1])

    def _intent(self, t: float) -> tuple[float, float, float, float]:
        """Where the person means to be (x, y) and to look (heading, pitch)."""
        ahead, left = self._station(t)
        a, b, c, d = self._sway
        s = self.drive.progress(t) + ahead + waves(t, [(0.12, 0.11, a)])
        place, _ = self.drive.route.along(s, self.drive.lane + left + waves(t, [(0.05, 0.17, b)]))
        _, coming = self.drive.route.along(self.drive.progress(t) + ahead + _ANTICIPATION)
        yaw, pitch = self._gaze(t)
        yaw += float(coming) + waves(t, [(0.03, 0.37, c)])
        return float(place[0]), float(place[1]), yaw, pitch + waves(t, [(0.02, 0.29, d)])

    def _station(self, t: float) -> tuple[float, float]:
        ahead, left = self.stations[0][1:]
        for share, next_ahead, next_left in self.stations[1:]:
            step = smooth_step((t - share * self.drive.duration) / _CHANGE_SECONDS)
            ahead += step * (next_ahead - ahead)
            left += step * (next_left - left)
        return ahead, left

    def _gaze(self, t: float) -> tuple[float, float]:
        """Yaw and pitch of the head to the way, radians."""
        yaw, pitch = self._glances[0][1:3]
        for start, next_yaw, next_pitch, seconds in self._glances[1:]:
            if t <= start:
                break
            step = smooth_step((t - start) / seconds)
            yaw += step * (next_yaw - yaw)
            pitch += step * (next_pitch - pitch)
        return yaw, pitch

    @cached_property
    def _sway(self) -> list[float]:
        return _phases(np.random.Generator(np.random.PCG64((self.seed, 2))), 4)

    @cached_property
    def _glances(self) -> list[tuple[float, float, float, float]]:
        """(start, yaw, pitch, seconds of turning the head) in order; the first one is along the way."""
        rng = np.random.Generator(np.random.PCG64((self.seed, 3)))
        out, t, along = [(0.0, 0.0, np.deg2rad(-9.0), 0.4)], 0.0, True
        while t < self.drive.duration + 1.0 and self.along < 1.0:
            share = self.along if along else 1.0 - self.along
            t += max(0.5, _GLANCE_PERIOD * share * float(rng.uniform(0.5, 1.5)))
            along = not along
            yaw, pitch = rng.normal(0.0, 4.0), rng.normal(-9.0, 2.0)
            if not along:
                yaw, pitch = rng.choice([-1.0, 1.0]) * rng.uniform(45.0, 110.0), rng.uniform(-15.0, 4.0)
            turn = abs(np.deg2rad(yaw) - out[-1][1])
            out.append((t, float(np.deg2rad(yaw)), float(np.deg2rad(pitch)), 0.25 + 0.2 * float(turn)))
        return out

"""A walking person: feet that stand still while they bear weight, and a head that sways with the steps.

Nothing here is a model of the estimator's: positions follow from the way walked and the cadence, in closed
form, and differ from person to person.  Sizes are those of the literature on gait: stance for 60 % of a
stride, step width 0.1 to 0.2 m, head excursions of 2 to 5 cm from peak to peak.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from numpy.typing import ArrayLike

from collabslam.errors import InputError
from collabslam.types import Array
from collabslam.worn_pose.config import Person

_STANCE = 0.6
_SHIN = 0.7
"""Share of a foot's way about the trunk that the shin makes at the scanner's height."""


@dataclass(frozen=True)
class Build:
    """How a person is made and walks; the true one, which the estimator knows only roughly.

    Attributes
    ----------
    camera_height : float
        Of Cf above the floor, upright and looking ahead, metres.
    neck_to_camera : (3,) tuple
        Along F's axes (right, down, ahead), metres.
    lean : (2,) tuple
        Of the neck before, and left of, the trunk, metres.
    leg_radius : float
        Metres.
    step_width : float
        Between the shins, metres.
    bob, sway, surge : float
        Amplitudes of the head's motion up and down, sideways and along, walking at 1.3 m/s, metres.
    phase : float
        Of the first step, strides.
    """

    camera_height: float = 1.70
    neck_to_camera: tuple[float, float, float] = (0.0, -0.10, 0.10)
    lean: tuple[float, float] = (0.0, 0.0)
    leg_radius: float = 0.06
    step_width: float = 0.16
    bob: float = 0.022
    sway: float = 0.025
    surge: float = 0.015
    phase: float = 0.0

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Build:
        """Somebody: near what `Person` has unless told, but not quite, by as much as that says it may err."""
        measured = Person()
        return cls(
            camera_height=float(measured.camera_height + rng.normal(0.0, measured.height_sd)),
            neck_to_camera=measured.neck_to_camera,
            lean=(float(rng.normal(0.0, measured.lever_sd)), float(rng.normal(0.0, measured.lever_sd))),
            leg_radius=float(rng.uniform(0.05, 0.07)),
            step_width=float(rng.uniform(0.12, 0.20)),
            bob=float(rng.uniform(0.015, 0.03)),
            sway=float(rng.uniform(0.015, 0.035)),
            surge=float(rng.uniform(0.005, 0.02)),
            phase=float(rng.uniform()),
        )


class Walker:
    """Legs and worn camera of a person whose trunk follows a path, in a world M whose z axis is up.

    Parameters
    ----------
    times : (N,) array
        Seconds, increasing, 0.1 s or less apart.
    path : (N, 2) array
        x and y of the trunk, metres.
    gaze : (N, 2) array, optional
        Where the head looks: heading (from x to y; continuous, not wrapped) and pitch (upwards), radians;
        along the path unless told.
    build : Build, optional
    """

    def __init__(
        self, times: ArrayLike, path: ArrayLike, gaze: ArrayLike | None = None, build: Build | None = None
    ) -> None:
        self._t, at = np.asarray(times, np.float64), np.asarray(path, np.float64)
        if self._t.ndim != 1 or len(self._t) < 2 or at.shape != (len(self._t), 2):
            raise InputError("A walker's path is (N, 2) metres at N times, two or more.")
        if not (np.isfinite(at).all() and (np.diff(self._t) > 0.0).all()):
            raise InputError("A walker's path is finite, at times that increase.")
        self.build = build or Build()
        self._stamps: list[float] = self._t.tolist()
        velocity = np.gradient(at, self._t, axis=0)
        speed = np.hypot(*velocity.T)
        stride = 0.5 + 0.6 * np.minimum(speed, 2.0)
        cadence = speed / stride
        steps = 0.5 * (cadence[1:] + cadence[:-1]) * np.diff(self._t)
        phase = self.build.phase + np.concatenate([[0.0], np.cumsum(steps)])
        heading = _heading(velocity, speed)
        ahead = np.column_stack([heading, np.zeros_like(heading)])
        seen = ahead if gaze is None else np.asarray(gaze, np.float64)
        if seen.shape != (len(self._t), 2):
            raise InputError("A walker's gaze is (N, 2) radians, heading and pitch, at its times.")
        self._table = np.column_stack([at, heading, phase, stride, speed, seen])

    def _at(self, t: float) -> list[float]:
        """x, y, heading, phase, stride, speed and gaze (2) of the trunk at time t."""
        k = min(max(bisect_right(self._stamps, t), 1), len(self._stamps) - 1)
        share = (t - self._stamps[k - 1]) / (self._stamps[k] - self._stamps[k - 1])
        share = min(max(share, 0.0), 1.0)
        row: list[float] = ((1.0 - share) * self._table[k - 1] + share * self._table[k]).tolist()
        return row

    def trunk(self, t: float) -> Array:
        """(2,) x, y of the trunk at time t, metres."""
        return np.array(self._at(t)[:2])

    def legs(self, t: float) -> Array:
        """(2, 3): x, y and radius of both shins in the scanner's plane at time t, metres."""
        x, y, heading, phase, stride, speed, _, _ = self._at(t)
        fade = speed / (speed + 0.1)
        ahead = np.array([np.cos(heading), np.sin(heading)])
        left = np.array([-ahead[1], ahead[0]])
        along = fade * stride * _SHIN * np.array([_foot(phase), _foot(phase + 0.5)])
        swing = 0.02 * fade * np.sin(2.0 * np.pi * np.array([phase, phase + 0.5]))
        aside = 0.5 * self.build.step_width * np.array([1.0, -1.0]) + swing
        at = np.array([x, y]) + along[:, None] * ahead + aside[:, None] * left
        return np.column_stack([at, np.full(2, self.build.leg_radius)])

    def camera(self, t: float) -> Array:
        """T_MF (4, 4) at time t: maps points of F (x right, y down, z ahead) into M."""
        b = self.build
        x, y, heading, phase, _, speed, yaw, pitch = self._at(t)
        pace = min(speed / 1.3, 1.5)
        once, twice = 2.0 * pi * phase, 4.0 * pi * phase
        c, s = cos(heading), sin(heading)
        forward = b.lean[0] + pace * b.surge * sin(twice + 0.7)
        aside = b.lean[1] + pace * b.sway * sin(once + 0.3)
        roll = 0.02 * pace * sin(once + 1.0)
        attitude = camera_attitude(yaw, pitch + 0.012 * pace * sin(twice), roll)
        out = np.eye(4)
        out[:3, :3] = attitude
        neck = b.camera_height + b.neck_to_camera[1] + pace * b.bob * cos(twice)
        out[:3, 3] = (x + c * forward - s * aside, y + s * forward + c * aside, neck)
        out[:3, 3] += attitude @ np.asarray(b.neck_to_camera)
        return out


def _foot(phase: float) -> float:
    """A foot before the trunk, in strides: back at the trunk's speed in stance, forward in swing."""
    u, half = phase % 1.0, 0.5 * _STANCE
    if u < _STANCE:
        return half - u
    w = (u - _STANCE) / (1.0 - _STANCE)
    return -half + _STANCE * (w - sin(2.0 * pi * w) / (2.0 * pi)) - (1.0 - _STANCE) * _ease(w)


def _ease(w: float) -> float:
    """Keeps the foot's speed continuous where it is set down and lifted."""
    return float(w * (1.0 - w) * (1.0 - 2.0 * w))


def camera_attitude(yaw: float, pitch: float, roll: float) -> Array:
    """R_MC (3, 3) of a camera that looks along x of M, turned left by yaw, up by pitch, then rolled, rad."""
    cy, cp, cr, sy, sp, sr = cos(yaw), cos(pitch), cos(roll), sin(yaw), sin(pitch), sin(roll)
    right, down = (sy, -cy, 0.0), (cy * sp, sy * sp, -cp)
    return np.array(
        [
            [cr * right[i] + sr * down[i], cr * down[i] - sr * right[i], ahead]
            for i, ahead in enumerate((cy * cp, sy * cp, sp))
        ]
    )


def _heading(velocity: Array, speed: Array) -> Array:
    """Headings of a path, kept where it stands still, continuous."""
    moving = speed > 0.1
    if not moving.any():
        return np.zeros(len(speed))
    known = np.unwrap(np.arctan2(velocity[moving, 1], velocity[moving, 0]))
    index = np.arange(len(speed))
    return np.asarray(np.interp(index, index[moving], known))

"""Laser scans and AHRS readings of a robot and a person who move through a floor plan.

Poses are functions of time that give (4, 4) matrices ``t_mc``: they map points of a camera (x right, y down,
z ahead) into M, the floor plan's world, whose z axis is up and whose floor is z = 0.  For a world W with a
camera's axes, give ``lambda t: Z_UP_FROM_Y_DOWN @ t_wc(t)`` (shifted so that the floor is at 0).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from collabslam.types import Array
from collabslam.worn_pose.readings import AhrsReading, LaserScan, Wearer
from collabslam_lab.worn_sensors.floor_plan import FloorPlan

Motion = Callable[[float], Array]
"""Pose ``t_mc`` (4, 4) at a time in seconds."""
Legs = Callable[[float], Array]
"""Circles (L, 3) at a time in seconds: x, y of M and radius, metres."""


@dataclass(frozen=True)
class LaserModel:
    """A scanner and its noise: by default the paper's (Table C1).

    Attributes
    ----------
    beams : int
    arc : float
        Radians, centred on the scanner's x axis.
    rate : float
        Scans a second.
    range_min, range_max : float
        Metres.
    noise : float
        Standard deviation of a range, metres.
    dropout : float
        Share of beams that see nothing, each by itself.
    sweep : float
        Seconds from the first beam to the last one.
    """

    beams: int = 133
    arc: float = float(np.radians(190.0))
    rate: float = 25.0
    range_min: float = 0.3
    range_max: float = 20.0
    noise: float = 0.02
    dropout: float = 0.02
    sweep: float = 0.0


@dataclass(frozen=True)
class AhrsModel:
    """An AHRS and its errors: by default Table C1's.

    The slow error of each axis is a sum of sines with random amplitudes: at every instant it is normal with
    the stated standard deviation, and it has nothing else in common with the estimator's Gauss-Markov bias.

    Attributes
    ----------
    rate : float
        Readings a second.
    tilt, yaw : float
        Standard deviations of the slow part: about both horizontal axes and about the vertical, radians.
    white : float
        Of what is new in each reading, per axis, radians.
    tilt_periods, yaw_periods : (2,) tuple
        Shortest and longest period of the sines, seconds: tilt follows accelerations, the heading the
        magnetic surroundings.
    """

    rate: float = 100.0
    tilt: float = float(np.radians(0.46))
    yaw: float = float(np.radians(0.98))
    white: float = float(np.radians(0.2))
    tilt_periods: tuple[float, float] = (2.0, 60.0)
    yaw_periods: tuple[float, float] = (30.0, 600.0)


def sensor_times(start: float, stop: float, rate: float, phase: float = 0.0) -> Array:
    """Stamps from ``start`` up to ``stop``, seconds, the first one ``phase`` seconds after the start."""
    count = max(0, int(np.floor((stop - start - phase) * rate + 1e-9)) + 1)
    return np.asarray(start + phase + np.arange(count) / rate)


def simulate_scans(
    plan: FloorPlan,
    times: ArrayLike,
    robot: Motion,
    t_c_scanner: Array,
    legs: Legs | None = None,
    *,
    rng: np.random.Generator,
    scanner: str = "front",
    model: LaserModel | None = None,
) -> list[LaserScan]:
    """Scans of one scanner.

    Parameters
    ----------
    plan : FloorPlan
    times : (N,) array
        Instants of the scans' first beams, seconds.
    robot : callable
        ``t_mc`` (4, 4) of Cs at a time.
    t_c_scanner : (4, 4) array
        Maps the scanner's points (x ahead, y left, z up) into C.
    legs : callable, optional
        Shins of everybody at a time, (L, 3); `Walker.legs`, or several of them stacked.
    rng : Generator
        Of the noise.
    scanner : str
        Name in `WornPoseConfig.scanners`.
    model : LaserModel, optional
    """
    m = model or LaserModel()
    angles = np.linspace(-0.5 * m.arc, 0.5 * m.arc, m.beams)
    rays = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(m.beams)])
    step = m.sweep / (m.beams - 1)
    parts = [slice(0, m.beams)] if m.sweep == 0.0 else [slice(i, i + 8) for i in range(0, m.beams, 8)]
    out = []
    for t in np.asarray(times, np.float64):
        ranges = np.empty(m.beams)
        for part in parts:
            now = float(t) + step * 0.5 * (part.start + min(part.stop, m.beams) - 1)
            pose = robot(now) @ t_c_scanner
            directions = rays[part] @ pose[:3, :3].T
            seen = plan.ranges(pose[:2, 3], directions[:, :2], None if legs is None else legs(now))
            with np.errstate(divide="ignore"):
                floor = np.where(directions[:, 2] < -1e-9, -pose[2, 3] / directions[:, 2], np.inf)
            ranges[part] = np.minimum(seen, floor)
        ranges += rng.normal(0.0, m.noise, m.beams)
        ranges[ranges > m.range_max] = np.inf
        ranges[(rng.random(m.beams) < m.dropout) | (ranges < m.range_min)] = np.nan
        increment = m.arc / (m.beams - 1)
        limits = (m.range_min, m.range_max)
        out.append(LaserScan(float(t), ranges, float(angles[0]), increment, scanner, *limits, step))
    return out


def simulate_ahrs(
    times: ArrayLike,
    camera: Motion,
    r_camera_ahrs: Array,
    *,
    rng: np.random.Generator,
    where: Wearer,
    model: AhrsModel | None = None,
) -> list[AhrsReading]:
    """Readings of the AHRS on a camera; N, the frame of its attitudes, has M's axes.

    Parameters
    ----------
    times : (N,) array
        Seconds.
    camera : callable
        ``t_mc`` of Cs for the robot's AHRS, ``t_mf`` of Cf for the worn one.
    r_camera_ahrs : (3, 3) array
        Turns the AHRS's axes into the camera's.
    rng : Generator
        Of the errors.
    where : {"robot", "worn"}
    model : AhrsModel, optional
    """
    m = model or AhrsModel()
    stamps = np.asarray(times, np.float64)
    slow = [_sines(stamps, sd, periods, rng) for sd, periods in _axes(m)]
    errors = np.column_stack(slow) + rng.normal(0.0, m.white, (len(stamps), 3))
    true = np.array([camera(float(t))[:3, :3] for t in stamps]).reshape(-1, 3, 3) @ r_camera_ahrs
    q = _quaternions(_small_turns(errors) @ true)
    return [AhrsReading(float(t), row, where) for t, row in zip(stamps, q, strict=True)]


def _small_turns(w: Array) -> Array:
    """(N, 3, 3) rotations of small rotation vectors (N, 3), by Cayley's map: exact to the third order."""
    k = np.zeros((len(w), 3, 3))
    k[:, [2, 0, 1], [1, 2, 0]] = 0.5 * w
    k[:, [1, 2, 0], [2, 0, 1]] = -0.5 * w
    return np.asarray(np.linalg.solve(np.eye(3) - k, np.eye(3) + k))


def _quaternions(r: Array) -> Array:
    """(N, 4) unit quaternions x, y, z, w of rotations (N, 3, 3)."""
    diagonal = np.diagonal(r, axis1=1, axis2=2)
    trace = diagonal.sum(axis=1)
    out = np.empty((len(r), 4))
    squares = np.column_stack([1.0 + 2.0 * diagonal - trace[:, None], 1.0 + trace])
    best = np.argmax(squares, axis=1)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        rows = best == i
        m = r[rows]
        out[rows, i] = squares[rows, i]
        out[rows, j] = m[:, j, i] + m[:, i, j]
        out[rows, k] = m[:, k, i] + m[:, i, k]
        out[rows, 3] = m[:, k, j] - m[:, j, k]
    m = r[best == 3]
    turn = np.column_stack([m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]])
    out[best == 3] = np.column_stack([turn, squares[best == 3, 3]])
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


def _axes(m: AhrsModel) -> Sequence[tuple[float, tuple[float, float]]]:
    return ((m.tilt, m.tilt_periods), (m.tilt, m.tilt_periods), (m.yaw, m.yaw_periods))


def _sines(times: Array, sd: float, periods: tuple[float, float], rng: np.random.Generator) -> Array:
    """A smooth random function that is normal with standard deviation ``sd`` at every instant."""
    count = 6
    rates = 2.0 * np.pi / np.exp(rng.uniform(np.log(periods[0]), np.log(periods[1]), count))
    sizes = rng.normal(0.0, sd / np.sqrt(count), (2, count))
    angle = times[:, None] * rates
    return np.asarray((sizes[0] * np.sin(angle) + sizes[1] * np.cos(angle)).sum(axis=1))

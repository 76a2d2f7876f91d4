"""Random walks of a robot and a person through corridors and rooms, to try the worn camera's pose on.

The place's middle line is drawn first, then both paths along it, then furniture wherever it does not stand in
their way: some of it hides the person for a while, as do the corners of a corridor and somebody who passes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from collabslam.types import Array
from collabslam_lab.worn_sensors import Build, FloorPlan, Walker, box, camera_attitude, polyline, table

CAMERA_HEIGHT = 0.95
_STEP = 0.02
_CLEAR = 0.45
"""Metres that furniture keeps from both paths."""


@dataclass(frozen=True)
class Walk:
    """A place, and who moves in it.

    Attributes
    ----------
    kind : str
    plan : FloorPlan
    robot : callable
        ``t_mc`` (4, 4) of Cs at a time.
    person : Walker
    others : list of Walker
    """

    kind: str
    plan: FloorPlan
    robot: Callable[[float], Array]
    person: Walker
    others: list[Walker]

    def legs(self, t: float) -> Array:
        """Everybody's shins at a time, (L, 3)."""
        return np.concatenate([w.legs(t) for w in (self.person, *self.others)])


def random_walk(rng: np.random.Generator, duration: float) -> Walk:
    """One of the three kinds of place, and a walk of ``duration`` seconds through it."""
    times = np.arange(-_STEP, duration + 2.0 * _STEP, _STEP)
    kind = ("corridor", "corner", "room")[int(rng.integers(3))]
    line, walls, width = _PLACES[kind](rng)
    speed = np.maximum(rng.uniform(0.7, 1.2) + _wander(times, 0.15, rng), 0.0)
    if rng.random() < 0.3:  # both stop for a while
        start = rng.uniform(0.3, 0.6) * duration
        speed = speed * (1.0 - _bump(times, start, start + 2.5, 0.8))
    way = 4.0 + np.concatenate([[0.0], np.cumsum(speed[1:] * _STEP)])
    side = 0.12 * (width - 1.6) * _wander(times, 1.0, rng)
    ahead, aside = _station(times, duration, width, rng)
    robot_path = line(way, side)
    person_path = line(way + ahead, aside)
    gaze = _gaze(times, person_path, rng)
    person = Walker(times, person_path, gaze, Build.drawn(rng))
    robot = _Robot(times, robot_path, rng)
    others = _passer(times, line, way, ahead, width, [robot_path, person_path], rng)
    paths = [robot_path, person_path, *(o[1] for o in others)]
    plan = _furnished(walls, kind, line, way, width, paths, rng)
    return Walk(kind, plan, robot, person, [o[0] for o in others])


Line = Callable[[Array, Array], Array]
"""Points (N, 2) at ways along a middle line (N,) and distances to its left (N,), metres."""


def _corridor(rng: np.random.Generator) -> tuple[Line, Array, float]:
    width = rng.uniform(2.4, 3.4)

    def line(way: Array, left: Array) -> Array:
        return np.column_stack([way, np.broadcast_to(left, np.shape(way))])

    walls = []
    for sign in (1.0, -1.0):  # doors stand back by 0.15 m
        points, x = [(-6.0, 0.5 * sign * width)], -6.0
        while x < 34.0:
            x += rng.uniform(1.5, 4.0)
            y = 0.5 * sign * width
            points += [(x, y), (x, y + 0.15 * sign), (x + 0.9, y + 0.15 * sign), (x + 0.9, y)]
            x += 0.9
        walls.append(polyline([*points, (x + 1.0, 0.5 * sign * width)]))
    ends = polyline([(-6.0, -width), (-6.0, width)])
    return line, np.concatenate([*walls, ends, ends + np.array([45.0, 0.0])]), width


def _corner(rng: np.random.Generator) -> tuple[Line, Array, float]:
    width, length, sign = rng.uniform(2.4, 3.4), rng.uniform(9.0, 13.0), rng.choice([-1.0, 1.0])
    radius = 1.2
    arc = 0.5 * np.pi * radius

    def line(way: Array, left: Array) -> Array:
        turn = np.clip((way - length) / radius, 0.0, 0.5 * np.pi)
        x = np.minimum(way, length) + radius * np.sin(turn)
        y = radius * (1.0 - np.cos(turn)) + np.maximum(way - length - arc, 0.0)
        return np.column_stack([x - left * sign * np.sin(turn), sign * y + left * np.cos(turn)])

    h, corner = 0.5 * width, length + radius
    inner = [(-6.0, h * sign), (corner - h, h * sign), (corner - h, 25.0 * sign)]
    outer = [(-6.0, -h * sign), (corner + h, -h * sign), (corner + h, 25.0 * sign)]
    ends = [polyline([(-6.0, -h), (-6.0, h)]), polyline([inner[-1], outer[-1]])]
    return line, np.concatenate([polyline(inner), polyline(outer), *ends]), width


def _room(rng: np.random.Generator) -> tuple[Line, Array, float]:
    a, b = rng.uniform(2.2, 2.8, 2)
    angle = np.linspace(0.0, 20.0 * np.pi, 8001)
    x, y = a * np.cos(angle), b * np.sin(angle)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    tangent = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))

    def line(way: Array, left: Array) -> Array:
        heading = np.interp(way, length, tangent)
        px, py = np.interp(way, length, x), np.interp(way, length, y)
        return np.column_stack([px - left * np.sin(heading), py + left * np.cos(heading)])

    return line, box(0.0, 0.0, 2.0 * a + 3.6, 2.0 * b + 4.2), 3.0


_PLACES = {"corridor": _corridor, "corner": _corner, "room": _room}


class _Robot:
    """``t_mc`` of a camera on a robot that follows a path and shakes a little."""

    def __init__(self, times: Array, path: Array, rng: np.random.Generator) -> None:
        velocity = np.gradient(path, times, axis=0)
        moving = np.hypot(*velocity.T) > 0.05
        heading = np.unwrap(np.arctan2(velocity[moving, 1], velocity[moving, 0]))
        heading = np.interp(times, times[moving], heading) + _wander(times, 0.04, rng)
        shake = [0.003 * _wander(times, 1.0, rng, (0.2, 1.0)) for _ in range(2)]
        self._start, self._rate = float(times[0]), 1.0 / _STEP
        self._table = np.column_stack([path, heading, *shake])

    def __call__(self, t: float) -> Array:
        u = (t - self._start) * self._rate
        k = min(max(int(u), 0), len(self._table) - 2)
        x, y, yaw, pitch, roll = ((k + 1 - u) * self._table[k] + (u - k) * self._table[k + 1]).tolist()
        out = np.eye(4)
        out[:3, :3] = camera_attitude(yaw, pitch, roll)
        out[:3, 3] = (x, y, CAMERA_HEIGHT)
        return out


def _station(times: Array, duration: float, width: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """How far before the robot and to the left of the middle line the person walks: ahead, beside or
    behind, and from one to another in the middle of the walk."""
    places = [(rng.uniform(1.2, 3.2), 0.4), (rng.uniform(0.0, 0.8), 0.7), (-rng.uniform(1.2, 2.8), 0.4)]
    first, second = rng.permutation(3)[:2] if rng.random() < 0.6 else (0, 0)
    share = _ease((times / duration - 0.4) / 0.3)
    ahead = (1.0 - share) * places[first][0] + share * places[second][0] + _wander(times, 0.15, rng)
    side = rng.choice([-1.0, 1.0])
    least = 0.85 * np.exp(-((ahead / 0.9) ** 4))
    aside = (1.0 - share) * places[first][1] + share * places[second][1] + _wander(times, 0.12, rng)
    return ahead, side * np.clip(np.maximum(np.abs(aside), least), 0.0, 0.5 * width - 0.35)


def _gaze(times: Array, path: Array, rng: np.random.Generator) -> Array:
    """The person looks along the way, around, and sometimes far to a side."""
    velocity = np.gradient(path, times, axis=0)
    moving = np.hypot(*velocity.T) > 0.1
    heading = np.unwrap(np.arctan2(velocity[moving, 1], velocity[moving, 0]))
    yaw = np.interp(times, times[moving], heading) + _wander(times, 0.3, rng, (1.5, 10.0))
    start = rng.uniform(0.1, 0.8) * times[-1]
    yaw = yaw + rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.2) * _bump(times, start, start + 2.0, 0.5)
    return np.column_stack([yaw, np.radians(-8.0) + _wander(times, 0.08, rng, (1.5, 10.0))])


def _passer(
    times: Array, line: Line, way: Array, ahead: Array, width: float, paths: list[Array],
    rng: np.random.Generator,
) -> list[tuple[Walker, Array]]:  # fmt: skip
    """In four walks of ten, somebody who comes the other way."""
    if rng.random() > 0.4:
        return []
    for _ in range(8):
        pace, start = rng.uniform(0.8, 1.3), rng.uniform(8.0, 16.0)
        left = rng.choice([-1.0, 1.0]) * (0.5 * width - 0.4)
        path = line(way[0] + start - pace * times, np.full(len(times), left))
        if all(np.hypot(*(path - p).T).min() > 0.45 for p in paths):
            return [(Walker(times, path, build=Build.drawn(rng)), path)]
    return []


def _furnished(
    walls: Array,
    kind: str,
    line: Line,
    way: Array,
    width: float,
    paths: list[Array],
    rng: np.random.Generator,
) -> FloorPlan:
    segments, circles = [walls], []
    trodden = np.concatenate([p[::10] for p in paths])
    reach = 0.5 * width if kind != "room" else 2.0
    for _ in range(40):
        at = line(
            np.array([rng.uniform(way[0] - 5.0, way[-1] + 6.0)]), np.array([rng.uniform(-reach, reach)])
        )[0]
        heading = rng.uniform(0.0, np.pi)
        x, y = at.tolist()
        what = int(rng.integers(4))
        if what == 0:
            piece = box(x, y, rng.uniform(0.3, 0.9), rng.uniform(0.3, 0.9), heading)
            corners = piece[:, 0]
        elif what == 1:
            posts = table(x, y, rng.uniform(0.6, 1.2), rng.uniform(0.6, 1.2), heading)
            corners = posts[:, :2]
        elif what == 2:
            posts = table(x, y, 0.4, 0.42, heading, 0.015)
            corners = posts[:, :2]
        else:
            posts = np.array([[*at, rng.uniform(0.06, 0.25)]])
            corners = posts[:, :2] + 0.2 * np.array([[1, 0], [0, 1], [-1, 0], [0, -1.0]])
        hull = np.concatenate([corners, 0.5 * (corners + np.roll(corners, 1, axis=0)), at[None]])
        if np.hypot(*(hull[:, None] - trodden).transpose(2, 0, 1)).min() < _CLEAR:
            continue
        if what == 0:
            segments.append(piece)
        else:
            circles.append(posts)
    return FloorPlan(np.concatenate(segments), np.concatenate(circles) if circles else None)


def _wander(
    times: Array, sd: float, rng: np.random.Generator, periods: tuple[float, float] = (3.0, 20.0)
) -> Array:
    """A smooth random function of standard deviation about ``sd``: a sum of sines."""
    rates = 2.0 * np.pi / np.exp(rng.uniform(np.log(periods[0]), np.log(periods[1]), 5))
    sizes = sd / np.sqrt(5.0) * rng.normal(size=(2, 5))
    angle = times[:, None] * rates
    return np.asarray((sizes[0] * np.sin(angle) + sizes[1] * np.cos(angle)).sum(axis=1))


def _ease(x: Array) -> Array:
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x**2))


def _bump(times: Array, start: float, stop: float, rise: float) -> Array:
    """0, then 1 from ``start`` to ``stop``, smooth over ``rise`` seconds on both sides."""
    return _ease((times - start) / rise + 1.0) * _ease((stop - times) / rise + 1.0)

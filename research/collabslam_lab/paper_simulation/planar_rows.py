"""Rows of observability matrices in 2-DoF, in exact rational arithmetic (METHOD 13).

A bearing is an arc tangent, its gradient is rational: with ``d = p - r`` and ``D = d . d`` it is
``(-d_z, d_x) / D`` by the point. Angles enter by rational cosines and sines only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

Q = Fraction
Row = list[Fraction]
Point = tuple[Fraction, Fraction]


@dataclass(frozen=True)
class Anchor:
    """An inverse-depth feature: anchor, rational direction (cosine, sine), inverse depth."""

    origin: Point
    direction: Point
    rho: Fraction

    @property
    def point(self) -> Point:
        """Where it is."""
        return (
            self.origin[0] + self.direction[0] / self.rho,
            self.origin[1] + self.direction[1] / self.rho,
        )

    def point_jacobian(self) -> list[list[Fraction]]:
        """2 x 4 derivative of the point by (x0, z0, angle, rho)."""
        (c, s), rho = self.direction, self.rho
        return [[Q(1), Q(0), -s / rho, -c / rho**2], [Q(0), Q(1), c / rho, -s / rho**2]]


def direction(t: Fraction) -> Point:
    """The rational point of the unit circle with half-angle tangent ``t``."""
    return (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)


def bearing_by_point(camera: Point, point: Point) -> Point:
    """Gradient of the bearing by the point; by the camera's position it is the negative."""
    x, z = point[0] - camera[0], point[1] - camera[1]
    return -z / (x * x + z * z), x / (x * x + z * z)


def bearing_rate_by_point(camera: Point, velocity: Point, point: Point) -> Point:
    """Gradient by the point of the bearing's rate, ``-(d_x v_z - d_z v_x) / D`` for a camera that moves."""
    x, z = point[0] - camera[0], point[1] - camera[1]
    square, cross = x * x + z * z, x * velocity[1] - z * velocity[0]
    return (
        -velocity[1] / square + 2 * x * cross / square**2,
        velocity[0] / square + 2 * z * cross / square**2,
    )


def squared_range_by_point(camera: Point, point: Point) -> Point:
    """Gradient by the point of half the squared range (of the same direction as that of the range)."""
    return point[0] - camera[0], point[1] - camera[1]


def lie_rows(camera: Point, velocity: Point, features: Sequence[Anchor], depths: int) -> list[Row]:
    """The paper's O (Eq. 13): zeroth and first order of every bearing, zeroth of the first ``depths`` depths.

    Columns x, z, heading, v_x, v_z, turn rate, then one rho each: anchors are known, as the paper has it.
    """
    rows = []
    for i, feature in enumerate(features):
        by = bearing_by_point(camera, feature.point)
        rate = bearing_rate_by_point(camera, velocity, feature.point)
        for g, heading, turn, moved in (
            (by, Q(-1), Q(0), (Q(0), Q(0))),
            (rate, Q(0), Q(-1), (-by[0], -by[1])),
        ):
            row = [-g[0], -g[1], heading, *moved, turn, *[Q(0)] * len(features)]
            row[6 + i] = _dot(g, [line[3] for line in feature.point_jacobian()])
            rows.append(row)
    for i in range(depths):
        row = [Q(0)] * (6 + len(features))
        row[6 + i] = -1 / features[i].rho ** 2
        rows.append(row)
    return rows


def moving_rows(
    camera: Point,
    velocity: Point,
    times: Sequence[Fraction],
    features: Sequence[Anchor],
    *,
    parameters: str,
    ranges: int,
) -> list[Row]:
    """Bearings at several times under constant velocity, and ranges from the first pose to some features.

    With enough times this holds what Lie derivatives of all orders hold. ``parameters``: ``rho`` (anchors
    known),
    ``anchor`` (4 a feature) or ``point`` (2 a feature). Columns as in `lie_rows`, then the features.
    """
    width = {"rho": 1, "anchor": 4, "point": 2}[parameters]
    rows = []
    for i, feature in enumerate(features):
        for t in times:
            at = (camera[0] + velocity[0] * t, camera[1] + velocity[1] * t)
            g = bearing_by_point(at, feature.point)
            head = [-g[0], -g[1], Q(-1), -g[0] * t, -g[1] * t, -t]
            rows.append(_row(head, g, feature, i, len(features), width))
    for i in range(ranges):
        g = squared_range_by_point(camera, features[i].point)
        head = [-g[0], -g[1], Q(0), Q(0), Q(0), Q(0)]
        rows.append(_row(head, g, features[i], i, len(features), width))
    return rows


def free_rows(cameras: Sequence[Point], points: Sequence[Point]) -> list[Row]:
    """Bearings from poses that no motion model ties together; columns are 3 a pose, then 2 a point."""
    rows = []
    for k, camera in enumerate(cameras):
        for i, point in enumerate(points):
            g = bearing_by_point(camera, point)
            row = [Q(0)] * (3 * len(cameras) + 2 * len(points))
            row[3 * k : 3 * k + 3] = [-g[0], -g[1], Q(-1)]
            at = 3 * len(cameras) + 2 * i
            row[at : at + 2] = g
            rows.append(row)
    return rows


def _row(head: Row, g: Point, feature: Anchor, i: int, count: int, width: int) -> Row:
    tail = [Q(0)] * (width * count)
    if width == 2:
        own = list(g)
    else:
        columns = list(zip(*feature.point_jacobian(), strict=True))
        own = [_dot(g, column) for column in (columns if width == 4 else columns[3:])]
    tail[width * i : width * (i + 1)] = own
    return head + tail


def _dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Q(0))

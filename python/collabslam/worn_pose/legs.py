"""Leg-like things in a scan: short runs of beams that stand free of what is behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam.types import Array, Indices, Mask
from collabslam.worn_pose.readings import LaserScan

_JUMP = 0.13
"""Difference of range from beam to beam that parts two things, metres."""
_LEG_WIDTH, _PAIR_WIDTH = 0.24, 0.50
_HIDDEN_EDGE_SD = 0.06
FARTHEST = 8.0
"""Metres up to which legs are looked for."""


@dataclass(frozen=True)
class Clusters:
    """Runs of beams that may be legs.

    Attributes
    ----------
    first, stop : (n,) int
        Slice of each in the scan's valid beams.
    centre : (n, 2) array
        Axis of a leg that would look so, in the points' frame, metres.
    covariance : (n, 2, 2) array
    wide : (n,) bool
        Too wide for one leg: may be both, side by side.
    """

    first: Indices
    stop: Indices
    centre: Array
    covariance: Array
    wide: Mask


def find_legs(
    scan: LaserScan, beams: Indices, points: Array, origin: Array, radius: float, range_sd: float
) -> Clusters:
    """Leg-like runs of a scan's valid beams.

    Parameters
    ----------
    scan : LaserScan
    beams : (N,) int
        Those that met something, increasing.
    points : (N, 2) array
        Where they end, metres.
    origin : (2,) array
        Of the scanner, in the points' frame.
    radius : float
        Of a leg, metres.
    range_sd : float
        Noise of a range, metres.
    """
    ranges, pitch = scan.ranges[beams], abs(scan.angle_increment)
    step = np.diff(ranges)
    breaks = np.flatnonzero((np.abs(step) > _JUMP) | (np.diff(beams) > 2)) + 1
    first = np.concatenate([[0], breaks])
    stop = np.concatenate([breaks, [len(ranges)]])
    count = stop - first
    middle = np.add.reduceat(ranges, first) / count
    spacing = middle * pitch
    width = spacing * (beams[stop - 1] - beams[first] + 1)
    # A neighbour that is nearer hides an edge; beams that met nothing hide none.
    previous, following = np.maximum(first - 1, 0), np.minimum(stop, len(ranges) - 1)
    before = (first > 0) & (beams[first] - beams[previous] <= 2) & (ranges[previous] < ranges[first])
    after = (stop < len(ranges)) & (beams[following] - beams[stop - 1] <= 2)
    after &= ranges[following] < ranges[stop - 1]
    enough = count >= np.maximum(1.0, np.floor(0.9 * radius / spacing))
    keep = (width <= _PAIR_WIDTH + spacing) & enough & ~(before & after) & (middle < FARTHEST)
    keep &= (beams[stop - 1] < len(scan.ranges) - 1) & (beams[first] > 0)
    first, stop, count, middle = first[keep], stop[keep], count[keep], middle[keep]
    spacing, width, hidden = spacing[keep], width[keep], (before | after)[keep]
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(points, axis=0)])
    mean = (sums[stop] - sums[first]) / count[:, None]
    ray = mean - origin
    ray = ray / np.hypot(ray[:, 0], ray[:, 1])[:, None]
    # Beams spread evenly over a circle meet it at pi / 4 of the radius before its middle, on average.
    centre = mean + 0.25 * np.pi * radius * ray
    along = range_sd**2 / count + (0.25 * radius) ** 2
    across = spacing**2 / 12.0 + 0.01**2 + hidden * _HIDDEN_EDGE_SD**2
    outer = ray[:, :, None] * ray[:, None, :]
    covariance = across[:, None, None] * np.eye(2) + (along - across)[:, None, None] * outer
    return Clusters(first, stop, centre, covariance, width > _LEG_WIDTH + spacing)

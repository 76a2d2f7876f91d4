"""Samples of a recording, and where a cost is least."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from collabslam.types import Array

CLEAR_GAIN = 0.85
"""A trial is believed if it brings the residual below this share of the residual without it."""


def spread(items: Sequence[int], count: int) -> list[int]:
    """At most ``count`` of the items, evenly."""
    if not items:
        return []
    return [int(items[k]) for k in np.unique(np.linspace(0, len(items) - 1, count).round().astype(int))]


def least(cost: Callable[[float], float], grid: Array, default: float) -> float:
    """Where a cost is least: on the grid, then between its points by a parabola."""
    return lowest(grid, np.array([cost(float(x)) for x in grid]), default)


def lowest(grid: Array, values: Array, default: float) -> float:
    """Where values on an even grid are lowest, between its points by a parabola; only finite ones count.

    Parameters
    ----------
    grid, values : (N,) array
    default : float
        What is returned where no value is finite.
    """
    known = np.where(np.isfinite(values), values, np.inf)
    k = int(np.argmin(known))
    if not np.isfinite(known[k]):
        return default
    if 0 < k < len(grid) - 1 and np.isfinite(known[[k - 1, k + 1]]).all():
        left, middle, right = known[k - 1 : k + 2]
        bend = left - 2.0 * middle + right
        if bend > 0.0:
            return float(grid[k] + 0.5 * (left - right) / bend * (grid[1] - grid[0]))
    return float(grid[k])

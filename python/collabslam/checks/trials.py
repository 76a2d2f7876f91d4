"""Trying things out: samples of a recording, and where a cost is least."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from collabslam.types import Array

CLEAR_GAIN = 0.85
"""A trial is believed if it brings the residual below this share of the residual without it."""
OFFSET_TOLERANCE = 0.25
"""Largest time offset that counts as none, as a share of the time between frames."""


def spread(items: Sequence[int], count: int) -> list[int]:
    """At most ``count`` of the items, evenly."""
    if not items:
        return []
    return [int(items[k]) for k in np.unique(np.linspace(0, len(items) - 1, count).round().astype(int))]


def least(cost: Callable[[float], float], grid: Array, default: float) -> float:
    """Where a cost is least: on the grid, then between its points by a parabola."""
    values = np.array([cost(float(x)) for x in grid])
    k = int(np.argmin(values))
    if not np.isfinite(values[k]):
        return default
    if 0 < k < len(grid) - 1 and np.isfinite(values[[k - 1, k + 1]]).all():
        left, middle, right = values[k - 1 : k + 2]
        bend = left - 2.0 * middle + right
        if bend > 0.0:
            return float(grid[k] + 0.5 * (left - right) / bend * (grid[1] - grid[0]))
    return float(grid[k])

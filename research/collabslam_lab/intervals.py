"""Intervals of means."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

_T95 = (12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145,
        2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048,
        2.045, 2.042)  # fmt: skip
"""Two-sided 95 % quantiles of Student's t for 1 to 30 degrees of freedom."""


def t_interval(values: Sequence[float]) -> tuple[float, float | None, float | None]:
    """Mean of independent values, and the ends of its 95 % interval; None for a single value."""
    mean, count = statistics.fmean(values), len(values)
    if count < 2:
        return mean, None, None
    quantile = _T95[min(count - 1, len(_T95)) - 1]
    half = quantile * statistics.stdev(values) / math.sqrt(count)
    return mean, mean - half, mean + half

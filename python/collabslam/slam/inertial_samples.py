"""Samples of an accelerometer or a gyroscope that wait for the frames around them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from collabslam._core import LAST_TIME, LONGEST_GAP
from collabslam.errors import InputError
from collabslam.formats.schema import Check, array, items, number, optional
from collabslam.slam.state import PersistentState
from collabslam.types import Array

MOST = 30_000
"""Samples that wait for a frame at most: half a minute at 1000 Hz."""
LARGEST_ACCELERATION = 1000.0
"""m/s^2: a hundred g, more than a sensor measures that tells which way is down."""


def acceleration_of(value: ArrayLike) -> Array:
    """A specific force (3,), m/s^2; raises InputError if it cannot be one."""
    try:
        found = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError("The acceleration is not an array of numbers; give three, m/s^2.") from error
    if found.shape != (3,):
        raise InputError(f"The acceleration has the shape {found.shape}; give three numbers, m/s^2.")
    if not np.isfinite(found).all():
        raise InputError("The acceleration is not finite; leave such samples out.")
    if np.abs(found).max() > LARGEST_ACCELERATION:
        raise InputError(
            f"The acceleration has {np.abs(found).max():g} m/s^2, which no sensor measures; give m/s^2, not "
            "thousandths of g or counts."
        )
    return found


class InertialSamples(PersistentState):
    """Samples (3,) with their stamps, the oldest of which are let go as frames pass."""

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_rows": array("<f8", None, 4),
        "_fresh": items(items(number(), 4)),
        "_last": optional(number(-LAST_TIME, LAST_TIME)),
    }

    def __init__(self) -> None:
        self._rows = np.empty((0, 4))
        self._fresh: list[tuple[float, ...]] = []  # appended to between frames, never in one
        self._last: float | None = None

    def check_next(self, t: float, what: str) -> None:
        """Raises InputError if a sample of ``what`` cannot come at ``t`` seconds, or too many wait."""
        if not math.isfinite(t) or abs(t) > LAST_TIME:
            raise InputError(f"The time {t} s of the {what} is not a time stamp in seconds; give seconds.")
        if self._last is not None and not 0.0 < t - self._last <= LONGEST_GAP:
            raise InputError(
                f"The time {t} s of the {what} does not follow the last one's, {self._last} s, within an "
                "hour; give samples in the order in which they were measured, each once."
            )
        if len(self._fresh) >= MOST:
            raise InputError(f"{MOST} samples of the {what} wait for a frame; give frames as they come.")

    def add(self, t: float, value: Array) -> None:
        """Takes a sample at ``t`` seconds that was checked."""
        self._fresh.append((t, *value.tolist()))
        self._last = t

    def add_all(self, times: Array, values: Array) -> None:
        """Takes samples (N, 3) at times (N,), which increase, seconds."""
        self._rows = np.concatenate([self._rows, np.column_stack([times, values])])

    def gather(self) -> None:
        """What came since the last frame joins the others."""
        if self._fresh:
            self._rows = np.concatenate([self._rows, np.array(self._fresh, np.float64)])
            self._fresh = []

    def between(self, begin: float, end: float) -> Array:
        """The samples (N, 3) from ``begin`` to before ``end``, seconds, of those that are gathered."""
        first, last = np.searchsorted(self._rows[:, 0], (begin, end))
        return np.asarray(self._rows[first:last, 1:])

    def forget_before(self, t: float) -> None:
        """Lets those before ``t`` seconds go."""
        self._rows = self._rows[np.searchsorted(self._rows[:, 0], t) :]

    def __len__(self) -> int:
        return len(self._rows)

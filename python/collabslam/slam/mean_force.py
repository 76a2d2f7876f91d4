"""Means of what an accelerometer says over intervals between frames, summed up as these come."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from collabslam.formats.schema import Check, array, number, refuse, whole
from collabslam.types import Array


class ForceMean(NamedTuple):
    """Sums over intervals.

    Attributes
    ----------
    seconds, weight : float
    force : (3,) float64
        Weighted specific forces along the axes of W.
    drift : float
        Weighted standard deviations of up by the frames' attitudes, rad.
    """

    seconds: float = 0.0
    weight: float = 0.0
    force: Array = np.zeros(3)
    drift: float = 0.0

    def plus(self, seconds: float, force: Array, drift: float, floor: float) -> ForceMean:
        """With one more interval; those whose up has drifted less than ``floor``, rad^2, weigh alike."""
        weight = seconds / (1.0 + drift / floor)
        return ForceMean(
            self.seconds + seconds,
            self.weight + weight,
            self.force + weight * force,
            self.drift + weight * float(np.sqrt(drift)),
        )

    def mean(self) -> tuple[Array, float]:
        """The mean force, and its variance by drift, rad^2, which is taken to be one error in all of them."""
        return self.force / self.weight, (self.drift / self.weight) ** 2


class VelocityChange(NamedTuple):
    """Changes of velocity over stretches of intervals that follow each other.

    Attributes
    ----------
    ended : (3,) float64
        Over the stretches before the present one, summed, in units of length a second.
    stretches, last : int
        How many there are, and the number of the last interval.
    first_speed, last_speed : (3,) float64
        Of the first interval and the last one of the present stretch.
    """

    ended: Array = np.zeros(3)
    stretches: int = 0
    last: int = -1
    first_speed: Array = np.zeros(3)
    last_speed: Array = np.zeros(3)

    def plus(self, number: int, speed: Array) -> VelocityChange:
        """With the interval of that number."""
        if self.stretches and number == self.last + 1:
            return self._replace(last=number, last_speed=speed)
        return VelocityChange(self.total, self.stretches + 1, number, speed, speed)

    @property
    def total(self) -> Array:
        """Over all stretches."""
        return np.asarray(self.ended + self.last_speed - self.first_speed)


def row(*checks: Check) -> Check:
    """A tuple, the items of which pass the checks."""

    def check(value: Any, where: str) -> None:
        if not isinstance(value, tuple) or len(value) != len(checks):
            refuse(where, f"a tuple of {len(checks)}")
        for one, item in zip(checks, value, strict=True):
            one(item, where)

    return check


def _force_mean(value: Any, where: str) -> None:
    row(_POSITIVE, _POSITIVE, _VECTOR, _POSITIVE)(value, where)
    if value[0] > 0.0 and not value[1] > 0.0:
        refuse(where, "a mean of anything")


_VECTOR, _POSITIVE = array("<f8", 3), number(0.0)
FORCE_MEAN: Check = _force_mean
VELOCITY_CHANGE = row(_VECTOR, whole(0), whole(-1), _VECTOR, _VECTOR)
"""What a file may say of them."""

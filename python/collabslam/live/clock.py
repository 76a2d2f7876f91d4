"""Another device's clock in the robot's time, from messages that went to the robot and came back."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

WINDOW = 64
"""Exchanges that are remembered."""
DRIFT_SD = 1e-4
"""Of the clocks' rates before anything is known of them: quartz keeps 100 ppm."""
FLOOR = 2e-4
"""Standard deviation of the fastest exchange, seconds: the operating systems' part."""
SET_ANEW = 3
"""So many exchanges running that contradict the estimate show a clock that was set."""


@dataclass(frozen=True)
class Exchange:
    """A message of a device to the robot and the robot's answer, as both clocks saw them, seconds.

    Attributes
    ----------
    sent, returned : float
        By the device's clock.
    received, answered : float
        By the robot's clock.
    """

    sent: float
    received: float
    answered: float
    returned: float

    @property
    def offset(self) -> float:
        """Robot's time less the device's, if both ways took the same time."""
        return 0.5 * ((self.received - self.sent) + (self.answered - self.returned))

    @property
    def delay(self) -> float:
        """Both ways together, seconds; the offset cannot be wrong by more than half of it."""
        return (self.returned - self.sent) - (self.answered - self.received)

    @property
    def possible(self) -> bool:
        """Whether such an exchange can have been."""
        numbers = (self.sent, self.received, self.answered, self.returned)
        return all(map(math.isfinite, numbers)) and self.delay >= 0.0 and self.answered >= self.received


@dataclass(frozen=True)
class _Line:
    """The offset as a line over the device's time, with its covariance."""

    middle: float
    offset: float
    drift: float
    variances: tuple[float, float, float]  # of the offset, of both, of the drift

    def at(self, t: float) -> tuple[float, float]:
        x = t - self.middle
        a, b, c = self.variances
        return self.offset + self.drift * x, a + 2.0 * b * x + c * x * x


class ClockEstimator:
    """Offset and drift of one device's clock.

    An exchange that waited in a queue says little, and what it says is wrong by at most half of its delay.
    So the offset is a line through the last `WINDOW` exchanges, each weighted by how much longer it took than
    the fastest.  That both ways of even the fastest may differ stays: a uniform error of half of its delay.
    """

    def __init__(self) -> None:
        self._kept: deque[Exchange] = deque(maxlen=WINDOW)
        self._outliers: list[Exchange] = []
        self._line: _Line | None = None
        self._time_correlated = 0.0

    def add(self, exchange: Exchange) -> bool:
        """Take an exchange; False if it cannot have been, or contradicts what is known."""
        if not exchange.possible:
            return False
        if self._contradicts(exchange):
            self._outliers.append(exchange)
            if len(self._outliers) < SET_ANEW:
                return False
            self._kept = deque(self._outliers, maxlen=WINDOW)
        else:
            self._kept.append(exchange)
        self._outliers = []
        self._fit()
        return True

    def robot_time(self, stamp: float) -> tuple[float, float] | None:
        """A stamp of the device in the robot's time, and its standard deviation, seconds; None at first."""
        if self._line is None:
            return None
        offset, variance = self._line.at(stamp)
        return stamp + offset, math.sqrt(variance + self._time_correlated)

    @property
    def drift(self) -> float:
        """Seconds that the device's clock loses per second."""
        return 0.0 if self._line is None else self._line.drift

    def _contradicts(self, exchange: Exchange) -> bool:
        if self._line is None:
            return False
        expected, variance = self._line.at(exchange.returned)
        slack = 0.5 * exchange.delay + 4.0 * math.sqrt(variance + self._time_correlated)
        return abs(exchange.offset - expected) > slack

    def _fit(self) -> None:
        kept = self._kept
        fastest = min(e.delay for e in kept)
        weights = [(FLOOR + 0.5 * (e.delay - fastest)) ** -2 for e in kept]
        total = sum(weights)
        start = kept[-1].offset
        middle = sum(w * e.returned for w, e in zip(weights, kept, strict=True)) / total
        mean = sum(w * (e.offset - start) for w, e in zip(weights, kept, strict=True)) / total
        spread = sum(w * (e.returned - middle) ** 2 for w, e in zip(weights, kept, strict=True))
        product = sum(
            w * (e.returned - middle) * (e.offset - start - mean) for w, e in zip(weights, kept, strict=True)
        )
        precision = spread + DRIFT_SD**-2
        self._line = _Line(middle, start + mean, product / precision, (1.0 / total, 0.0, 1.0 / precision))
        self._time_correlated = fastest**2 / 12.0

"""What the gyroscope of a device says while it takes images: how it turned when one was taken."""

from __future__ import annotations

from collections import deque

import numpy as np

from collabslam._core import GYRO_GAP, Filter
from collabslam.errors import DataError, InputError
from collabslam.types import Array

KEPT = 256
"""Samples of a device that are kept: a second of the fastest."""
AHEAD = 0.02
"""Seconds after the last sample for which that is still taken: the next one may be on its way."""


class DeviceRates:
    """The last rates of one device, by its own clock, in order."""

    def __init__(self) -> None:
        self._session = ""
        self._times: deque[float] = deque(maxlen=KEPT)
        self._rates: deque[Array] = deque(maxlen=KEPT)

    def add(self, session: str, t: float, rate: Array) -> None:
        """A rate (3,), rad/s along the axes of its camera; another session begins anew.

        Raises
        ------
        DataError
            For a rate that is none, and one that does not follow the last.
        """
        try:
            Filter.check_gyro(rate)
        except InputError as error:
            raise DataError(str(error)) from error
        if session != self._session:
            self._session = session
            self._times.clear()
            self._rates.clear()
        if self._times and t <= self._times[-1]:
            raise DataError(f"The rate of {t:.3f} s does not follow the last one, {self._times[-1]:.3f} s.")
        self._times.append(t)
        self._rates.append(rate)

    def at(self, session: str, t: float) -> Array | None:
        """The rate (3,) at a time between two samples, or just after the last; None where none tells it."""
        if session != self._session or not self._times:
            return None
        times = np.array(self._times)
        after = int(np.searchsorted(times, t))
        if after == len(times):
            return self._rates[-1] if t - times[-1] <= AHEAD else None
        if after == 0:
            return self._rates[0] if t == times[0] else None
        before = after - 1
        gap = times[after] - times[before]
        if gap > GYRO_GAP:
            return self._rates[after] if t == times[after] else None
        share = (t - times[before]) / gap
        return np.asarray((1.0 - share) * self._rates[before] + share * self._rates[after])

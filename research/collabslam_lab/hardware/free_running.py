"""A worn camera with a clock of its own: its views are of any time, and come late (METHOD section 21)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import SettingsError
from collabslam.types import Frame, Recording, WornView

WornAt = Callable[[float, int], WornView | None]
"""What Cf sees at a time (seconds), as its view of that number; None where it sees nothing of use."""


@dataclass(frozen=True)
class WornClock:
    """When Cf takes its views, and when they arrive.

    Attributes
    ----------
    rate : float
        Views per second.
    phase : float
        When the first one is taken, seconds after the recording's first frame.
    late : float
        Seconds from taking to arrival.

    Raises
    ------
    SettingsError
        If a number is not finite, the rate not above zero, or another one below it.
    """

    rate: float
    phase: float = 0.0
    late: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite([self.rate, self.phase, self.late]).all() and self.rate > 0.0):
            raise SettingsError(f"A worn camera at {self.rate} views a second is not allowed; give 7 to 30.")
        if min(self.phase, self.late) < 0.0:
            raise SettingsError(
                f"The phase {self.phase} and the lateness {self.late} of the worn camera are not allowed; "
                "give seconds that are zero or more."
            )

    def arrived(self, first: float, after: float, until: float) -> range:
        """Numbers of the views that arrive after one time and until another; ``first`` is frame 0's."""
        start = first + self.phase + self.late
        # To the microsecond: what is due with a frame comes with it.
        low, high = ((t + 1e-6 - start) * self.rate for t in (after, until))
        return range(max(0, int(np.floor(low)) + 1), int(np.floor(high)) + 1)

    def taken(self, first: float, number: int) -> float:
        """When the view of that number is taken, seconds."""
        return first + self.phase + number / self.rate


class FreeRunning(WrappedRecording):
    """A recording whose Cf runs on a clock of its own.

    Parameters
    ----------
    base : Recording
    worn_at : callable
        What Cf sees.
    clock : WornClock
    """

    def __init__(self, base: Recording, worn_at: WornAt, clock: WornClock) -> None:
        super().__init__(base)
        self._worn_at, self._clock = worn_at, clock

    def frame(self, i: int) -> Frame:
        """Frame ``i`` with the newest view that has arrived since the frame before, if it is of use."""
        times, image = self.times, self.image(i)
        first, t = float(times[0]), float(times[i])
        before = float(times[i - 1]) if i else -np.inf
        numbers = self._clock.arrived(first, max(before, first - 1.0), t)
        worn = self._worn_at(self._clock.taken(first, numbers[-1]), numbers[-1]) if numbers else None
        return Frame(i, t, image, () if worn is None else (worn,))

"""A clock that is never set: it starts with the system's time, or with a recording's, and only goes on."""

from __future__ import annotations

import time


class MonotonicClock:
    """Seconds that pass evenly.

    Parameters
    ----------
    start : float, optional
        What it shows at first; the system's time if left out.
    """

    def __init__(self, start: float | None = None) -> None:
        self._begun = time.monotonic()
        self._start = time.time() if start is None else start

    def now(self) -> float:
        """Seconds."""
        return self._start + (time.monotonic() - self._begun)


def nanoseconds(t: float) -> int:
    """A time in seconds as whole nanoseconds, from which `seconds` makes the same bits again."""
    whole = int(t // 1.0)
    return whole * 10**9 + round((t - whole) * 1e9)


def seconds(stamp: int) -> float:
    """Whole nanoseconds as seconds."""
    return stamp / 10**9

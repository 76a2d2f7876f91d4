"""How long the stages of a frame take."""

from __future__ import annotations

import time


class StageTimes:
    """Milliseconds per stage of one frame, from where it is made."""

    def __init__(self) -> None:
        self._began = self._last = time.perf_counter()
        self._ms: dict[str, float] = {}

    def done(self, stage: str) -> None:
        """A stage is over; the next one begins."""
        now = time.perf_counter()
        self._ms[f"ms_{stage}"] = 1e3 * (now - self._last)
        self._last = now

    def all(self) -> dict[str, float]:
        """``ms_`` and the name of each stage, and ``ms_total``."""
        return {**self._ms, "ms_total": 1e3 * (self._last - self._began)}

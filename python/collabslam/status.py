"""Whether the estimate can be trusted: OK, COASTING, LOST."""

from __future__ import annotations

from collabslam.keeping import Keeper
from collabslam.types import Status

MIN_MATCHES = 8
"""Accepted matches that make a frame OK."""
MAX_COASTING = 1.0
"""Seconds without an OK frame after which the camera is lost."""


class StatusMonitor(Keeper):
    """OK: at least :data:`MIN_MATCHES` accepted matches in this frame; COASTING: fewer, for at most
    :data:`MAX_COASTING` seconds; LOST: longer."""

    KEPT = ("_last_ok",)

    def __init__(self) -> None:
        self._last_ok: float | None = None

    def update(self, t: float, accepted: int) -> Status:
        """Status of the frame at ``t`` (seconds) with this number of accepted matches."""
        if self._last_ok is None:
            self._last_ok = t
        if accepted >= MIN_MATCHES:
            self._last_ok = t
            return Status.OK
        return Status.COASTING if t - self._last_ok <= MAX_COASTING else Status.LOST

"""Waiting for what must come, however busy the machine is."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

LONGEST = 600.0
"""Seconds after which something hangs: a limit that no busy machine comes near, never a measure of speed."""


def until(true: Callable[[], object]) -> bool:
    """Whether it has come true."""
    end = time.monotonic() + LONGEST
    while not (came := true()) and time.monotonic() < end:
        time.sleep(0.01)
    return bool(came)


def connected(session: Any) -> bool:
    """Whether anybody is at the other end of a session of Zenoh."""
    return any(True for _ in session.info.peers_zid())

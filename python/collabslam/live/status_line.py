"""One line of how it goes: written over itself on a terminal, now and then elsewhere."""

from __future__ import annotations

import shutil
import sys
import threading
import time
from typing import TextIO

WITH = {"collab": "with the worn camera", "mono": "alone"}
"""Whether the worn camera helped in a frame, in words."""
ON_TERMINAL, ELSEWHERE = 0.5, 30.0
"""Seconds between two lines on a terminal, and in a log."""


class StatusLine:
    """Shows the latest text; any thread may call.

    Parameters
    ----------
    stream : file, optional
        Standard error if left out.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty()
        self._next = -float("inf")
        self._lock = threading.Lock()

    def show(self, text: str) -> None:
        """Show a text, unless one was shown just now; a stream that nobody reads is left alone."""
        now = time.monotonic()
        with self._lock:
            if now < self._next:
                return
            self._next = now + (ON_TERMINAL if self._terminal else ELSEWHERE)
            try:
                if self._terminal:
                    width = shutil.get_terminal_size().columns - 1
                    self._stream.write(f"\r{text[:width]:<{width}}")
                else:
                    self._stream.write(f"collabslam: {text}\n")
                self._stream.flush()
            except (OSError, ValueError):
                self._next = float("inf")

    def end(self) -> None:
        """Leave the line."""
        with self._lock:
            if self._terminal and 0.0 < self._next < float("inf"):
                self._stream.write("\n")
            self._next = float("inf")

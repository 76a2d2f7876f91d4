"""Ctrl-C and SIGTERM while a run goes on: they wait for the end of a frame."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any


class Interrupts:
    """Holds signals back until `let_through` is called; use it as a context manager.

    What waits are the signals that would raise an exception in the middle of a frame: those of the main
    thread that Python code handles.  A second one does not wait, as somebody is in a hurry.
    """

    def __init__(self) -> None:
        self._handlers: dict[int, Any] = {}
        self._waiting: int | None = None

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                handler = signal.getsignal(number)
                if callable(handler):
                    self._handlers[number] = handler
                    signal.signal(number, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        if error is None:
            self.let_through()

    def let_through(self) -> None:
        """Handles the signal that waits, if one does: raises what its handler raises."""
        number, self._waiting = self._waiting, None
        if number is not None:
            self._handlers[number](number, None)

    def _note(self, number: int, frame: FrameType | None) -> None:
        hurry = self._waiting is not None
        self._waiting = number
        if hurry:
            self.let_through()

"""Output into a pipe that nobody reads any more, as in ``collabslam ... | head``, is dropped silently."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import Any


class _Quiet:
    """A text stream that goes on as if nothing had happened when its reader is gone."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """As of any text stream."""
        try:
            self._stream.write(text)
        except BrokenPipeError:
            self._drop()
        return len(text)

    def flush(self) -> None:
        """As of any text stream."""
        try:
            self._stream.flush()
        except BrokenPipeError:
            self._drop()

    def _drop(self) -> None:
        """From now on, and with what is held back, into nothing; the interpreter's last flush too."""
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, self._stream.fileno())
        os.close(nothing)


@contextlib.contextmanager
def quiet_pipes() -> Iterator[None]:
    """Closed pipes are no error while the block runs: work goes on, and its exit status is its own."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _Quiet(before[0]), _Quiet(before[1])
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        sys.stdout, sys.stderr = before

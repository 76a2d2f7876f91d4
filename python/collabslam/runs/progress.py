"""How a run tells that it goes on: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any, TextIO

_SECONDS_BETWEEN_LINES = 2.0


class Progress:
    """Counts frames (or what ``unit`` names) on a stream; use it as a context manager.

    Parameters
    ----------
    total : int
        Frames to come.
    label : str
    enabled : bool
        False says nothing at all.
    stream : text stream, optional
        Standard error by default.
    unit : str
    done : int
        Frames that were done before, by a run that this one goes on with.
    """

    def __init__(
        self,
        total: int,
        label: str,
        *,
        enabled: bool = True,
        stream: TextIO | None = None,
        unit: str = "frame",
        done: int = 0,
    ) -> None:
        self._total, self._label, self._unit = total, label, unit
        self._stream = sys.stderr if stream is None else stream
        self._lines = enabled and not self._stream.isatty()
        self._done = done
        self._said = self._began = time.monotonic()
        self._bar: Any = None
        if enabled and not self._lines:
            from tqdm import tqdm

            self._bar = tqdm(
                initial=done, total=total, desc=label, unit=unit, file=self._stream, dynamic_ncols=True
            )

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    def update(self, note: str = "") -> None:
        """One frame is done; ``note`` is shown beside the count."""
        self._done += 1
        if self._bar is not None:
            self._bar.set_postfix_str(note, refresh=False)
            self._bar.update()
        now = time.monotonic()
        if self._lines and (now - self._said >= _SECONDS_BETWEEN_LINES or self._done == self._total):
            self._said = now
            rate = self._done / max(now - self._began, 1e-9)
            text = (
                f"{self._label}: {self._done}/{self._total} {self._unit}s, {rate:.1f} {self._unit}s/s, {note}"
            )
            print(text.rstrip(", "), file=self._stream, flush=True)

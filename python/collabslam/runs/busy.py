"""A line of what is being done, for work that counts no frames: nothing at all where it is soon done."""

from __future__ import annotations

import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

SILENCE = 2.0
"""Seconds that may pass without a word."""
_LINES = 5
"""Times `SILENCE` between two lines of one text, where lines stay."""
Tell = Callable[[str], None]


def say_nothing(text: str) -> None:
    """In the place of what `busy` gives, where nobody listens."""


@contextmanager
def busy(text: str, *, stream: TextIO | None = None, silence: float = SILENCE) -> Iterator[Tell]:
    """Say what is being done, and for how long, once it takes longer than a moment.

    Parameters
    ----------
    text : str
        What is done at first; the function that is given tells what is done next.
    stream : text stream, optional
        Standard error if left out.  On a terminal a line is written over itself and gone at the end.
    silence : float
        Seconds.
    """
    out = sys.stderr if stream is None else stream
    doing, ended, began = [text], threading.Event(), time.monotonic()

    def show() -> None:
        said, after, shown = "", 0, ""
        while not ended.wait(silence / 4.0 if shown else silence):
            seconds = f"{doing[0]}, {time.monotonic() - began:.0f} s"
            if out.isatty():
                width = shutil.get_terminal_size().columns - 1
                shown = f"\r{seconds[:width]:<{width}}"
                out.write(shown)
            elif after == 0 or doing[0] != said:
                out.write(f"collabslam: {seconds}\n")
                said, after = doing[0], _LINES
            else:
                after -= 1
            out.flush()
        if shown:
            out.write(f"\r{'':<{len(shown) - 1}}\r")
            out.flush()

    def watch() -> None:
        with suppress(OSError, ValueError):  # nobody reads any more
            show()

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield lambda now: doing.__setitem__(0, now)
    finally:
        ended.set()
        thread.join()

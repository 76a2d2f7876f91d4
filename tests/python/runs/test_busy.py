"""The line of what is being done."""

from __future__ import annotations

import io
import threading

import pytest

from collabslam.runs.busy import busy


class Stream(io.StringIO):
    """Says when something was written into it."""

    def __init__(self, *, terminal: bool) -> None:
        super().__init__()
        self._terminal, self.written = terminal, threading.Event()

    def isatty(self) -> bool:
        return self._terminal

    def write(self, text: str) -> int:
        count = super().write(text)
        self.written.set()
        return count


@pytest.mark.parametrize("terminal", [False, True])
def test_what_takes_long_says_what_it_does(terminal: bool) -> None:
    stream = Stream(terminal=terminal)
    with busy("reading", stream=stream, silence=0.01) as tell:
        assert stream.written.wait(60.0)
        tell("matching")
        while "matching, " not in stream.getvalue():
            stream.written.clear()
            assert stream.written.wait(60.0)
    assert "reading, " in stream.getvalue()
    assert stream.getvalue().endswith("\r") == terminal  # a terminal is left as it was


def test_what_is_soon_done_says_nothing() -> None:
    stream = Stream(terminal=False)
    with busy("reading", stream=stream, silence=60.0):
        pass
    assert stream.getvalue() == ""


def test_a_stream_that_nobody_reads_ends_nothing() -> None:
    stream = Stream(terminal=False)
    stream.close()
    with busy("reading", stream=stream, silence=0.0):
        done = threading.Event().wait(0.05)
    assert not done

"""The line of how a live run goes."""

from __future__ import annotations

import io

import pytest

from collabslam.live.status_line import StatusLine


class Terminal(io.StringIO):
    """A terminal."""

    def isatty(self) -> bool:
        return True


def test_a_terminal_has_one_line_and_a_log_few() -> None:
    for stream, first in ((Terminal(), "\rframe 0"), (io.StringIO(), "collabslam: frame 0\n")):
        line = StatusLine(stream)
        for k in range(100):
            line.show(f"frame {k}")
        assert stream.getvalue().startswith(first)
        assert stream.getvalue().count("frame") <= 2
        line.end()
        line.show("after the end")
        assert "after" not in stream.getvalue()


@pytest.mark.parametrize("error", [OSError("nobody reads"), ValueError("closed")])
def test_a_stream_that_nobody_reads_ends_nothing(error: Exception) -> None:
    class Closed(io.StringIO):
        def write(self, text: str) -> int:
            raise error

    line = StatusLine(Closed())
    line.show("a")
    line.show("b")
    line.end()

"""The line of how a live run goes, and the words of status in it and elsewhere."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest

import collabslam
from collabslam.checks.doctor import _REMEDIES
from collabslam.live.messages import LEVELS
from collabslam.live.status_line import StatusLine
from collabslam.runs.report import DEGRADED_BY
from collabslam.types import Status
from collabslam.viz.plot import NOT_OK

PACKAGE = Path(collabslam.__file__).parent


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


def test_the_words_of_status_are_the_same_everywhere() -> None:
    words = {status.value for status in Status}
    assert set(LEVELS) == words | {"STALE"}  # a device whose images stay away
    assert {"OK", *NOT_OK} == words
    for shown in ("rerun_log.py", "rerun_layout.py"):
        assert words <= set(re.findall(r"[A-Z_]+", (PACKAGE / "viz" / shown).read_text()))
    assert set(_REMEDIES) == set(DEGRADED_BY)
    lost = PACKAGE.parents[1] / "docs" / "lost.md"
    if lost.exists():
        told = lost.read_text(encoding="utf-8").split("| status | when |")[1].split("\n\n")[0]
        assert set(re.findall(r"(?m)^\| ([A-Z_]+) \|", told)) == words
        assert "| NOT_STARTED, OK, DEGRADED, COASTING, LOST |" in (lost.parent / "glossary.md").read_text()

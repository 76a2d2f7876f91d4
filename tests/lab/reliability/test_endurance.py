"""A long session, in short: frames without end through one engine, and engines made and dropped."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from collabslam.errors import DataError
from collabslam.simulation.recording import corridor_recording
from collabslam_lab.reliability import measure as reliability
from collabslam_lab.reliability.endurance import endure_session, looped, many_dropped


def test_a_walk_goes_forth_and_back() -> None:
    frames = [corridor_recording(length_m=1.5).frame(i) for i in range(4)]
    assert [looped(frames, k).index for k in range(8)] == [0, 1, 2, 3, 2, 1, 0, 1]


def test_a_session_stays_sound() -> None:
    shown = endure_session(9.0, seed=2)
    assert shown.frames == 90
    assert shown.sound
    assert shown.ok_share > 0.8  # at both ends of the walk the camera turns back within a frame
    assert shown.memory_growth_mb < 50.0 or math.isnan(shown.memory_growth_mb)
    assert shown.memory_mb >= shown.memory_growth_mb or math.isnan(shown.memory_mb)


def test_engines_that_are_dropped_leave_little() -> None:
    grown = many_dropped(5, 2)
    assert grown < 20.0 or math.isnan(grown)


def test_a_file_of_something_else_is_refused_before_anything_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reliability, "run_kills", lambda *_: pytest.fail("measured"))
    out = tmp_path / "reliability.json"
    for text in ("[]", '{"fuzz_readers": 200000}', "{"):
        out.write_text(text)
        with pytest.raises(DataError, match="remove it"):
            reliability.measure(("kills",), out)
        assert out.read_text() == text


def test_what_was_measured_is_kept_when_a_later_part_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "reliability.json"
    out.write_text('{"fuzz_core": {"executions": 5, "findings": 1}}')
    monkeypatch.setattr(reliability, "run_kills", lambda *_: 3)
    monkeypatch.setattr(reliability, "fuzz_readers", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        reliability.measure(("kills", "readers"), out)
    kept = json.loads(out.read_text())
    assert (kept["kills_survived"], kept["fuzz_executions"], kept["fuzz_findings"]) == (3, 5, 1)

"""A long session, in short: frames without end through one engine, and engines made and dropped."""

from __future__ import annotations

import math

from collabslam.demo.recording import corridor_recording
from collabslam.reliability.endurance import endure_session, looped, many_dropped


def test_a_walk_goes_forth_and_back() -> None:
    frames = [corridor_recording(length_m=1.5).frame(i) for i in range(4)]
    assert [looped(frames, k).index for k in range(8)] == [0, 1, 2, 3, 2, 1, 0, 1]


def test_a_session_stays_sound() -> None:
    shown = endure_session(9.0, seed=2)
    assert shown.frames == 90
    assert shown.sound
    assert shown.ok_share > 0.8  # at both ends of the walk the camera turns back within a frame
    assert shown.memory_growth_mb < 50.0 or math.isnan(shown.memory_growth_mb)


def test_engines_that_are_dropped_leave_little() -> None:
    grown = many_dropped(5, 2)
    assert grown < 20.0 or math.isnan(grown)

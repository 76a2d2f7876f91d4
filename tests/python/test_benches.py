"""The Python side of the benches runs with today's calls."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

BENCHES = Path(__file__).parents[2] / "benches"
REPLAY = BENCHES / "replay.py"


def bench(name: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A program of the benches as a module; what it sets for its own process is taken back."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    spec = importlib.util.spec_from_file_location(name, BENCHES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_slowest_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    milliseconds = [float(k) for k in range(200, 0, -1)]
    assert bench("frames", monkeypatch).tail(np.array(milliseconds)) == pytest.approx((198.0, 200.0))
    slow = bench("compare", monkeypatch).tails({"step": milliseconds, "one": [3.0]})
    assert slow == {"p99_ms": {"step": 198.0, "one": 3.0}, "worst_ms": {"step": 200.0, "one": 3.0}}


def test_without_an_environment_the_other_system_is_said_to_be_missing(
    clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "collabslam-lab peers makes it" in bench("frames", monkeypatch).orbslam3(clip.recording, tmp_path)


def test_a_recorded_replay_is_timed_frame_by_frame() -> None:
    places = [(100 + 60 * k, 80 + 37 * (k % 9)) for k in range(9)]
    births = ";".join(f"{u},{v},{2 + 0.1 * k},0.1" for k, (u, v) in enumerate(places))
    # The filter's first block is the readout.
    seen = ";".join(f"{k},{u},{v}" for k, (u, v) in enumerate(places, start=1))
    lines = f"0;{births}|0.1;{seen}|0.2;{seen}"
    done = subprocess.run(
        [sys.executable, str(REPLAY), "2"], input=lines, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert len([int(ns) for ns in done.stdout.split("|") if int(ns) > 0]) == 4

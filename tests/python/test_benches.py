"""The Python side of the benches runs with today's calls."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

REPLAY = Path(__file__).parents[2] / "benches" / "replay.py"


def test_a_recorded_replay_is_timed_frame_by_frame() -> None:
    places = [(100 + 60 * k, 80 + 37 * (k % 9)) for k in range(9)]
    births = ";".join(f"{u},{v},{2 + 0.1 * k},0.1" for k, (u, v) in enumerate(places))
    seen = ";".join(f"{k},{u},{v}" for k, (u, v) in enumerate(places))
    lines = f"0;{births}|0.1;{seen}|0.2;{seen}"
    done = subprocess.run(
        [sys.executable, str(REPLAY), "2"], input=lines, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert len([int(ns) for ns in done.stdout.split("|") if int(ns) > 0]) == 4

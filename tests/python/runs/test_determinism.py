"""The same input gives the same bits: across processes, numbers of threads, and with the viewer on or off."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.clip import Clip, Short

from collabslam.datasets import write_recording
from collabslam_lab.reliability.kills import compare_results

pytestmark = pytest.mark.slow

FRAMES = 12
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")


def run(recording: Path, out: Path, threads: int, hashes: str, *options: str) -> Path:
    """A run in a process of its own."""
    environment = {**os.environ, **dict.fromkeys(THREADS, str(threads)), "PYTHONHASHSEED": hashes}
    command = [sys.executable, "-m", "collabslam", "run", str(recording), "--out", str(out), *options]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def recording(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(Short(clip, FRAMES), tmp_path_factory.mktemp("walk") / "walk")


@pytest.fixture(scope="module")
def alone(recording: Path) -> Path:
    return run(recording, recording.parent / "one", 1, "1")


def test_threads_and_processes_do_not_matter(recording: Path, alone: Path) -> None:
    assert compare_results(alone, run(recording, recording.parent / "two", 2, "2")) == []


def test_the_viewer_does_not_matter(recording: Path, alone: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    log = tmp_path / "view.rrd"
    viewed = run(recording, recording.parent / "viewed", 1, "1", "--save", str(log))
    assert log.stat().st_size > 0
    assert compare_results(alone, viewed) == []

"""The examples run as they stand and come out right."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[2] / "examples"
ARGUMENTS = {
    "frame_loop": ["--frames", "6"],
    "own_recording": ["--frames", "5"],
    "range_finder": ["--frames", "6"],
}


def play(name: str) -> str:
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), *ARGUMENTS.get(name, [])]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def numbers(text: str) -> list[float]:
    return [float(x) for x in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", text)]


def test_every_example_is_tested() -> None:
    names = {p.stem for p in EXAMPLES.glob("*.py")}
    assert names == {"filter_alone", "frame_loop", "own_recording", "range_finder"}


def test_the_notebook_runs_and_shows_pictures() -> None:
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(EXAMPLES / "first_steps.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "what it showed once is not kept"
    nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 3
    printed = "".join(output.get("text", "") for output in outputs)
    assert "OK - scale known to" in printed


def test_filter_alone() -> None:
    first, second, third = play("filter_alone").splitlines()
    x, truth, sigma = numbers(first)
    assert abs(x - truth) < 4.0 * sigma < 0.4
    assert "13, then 41 blocks" in second  # the readout, and 40 landmarks
    *ids, correlation = numbers(third)
    assert ids == [1.0, 2.0]
    assert 0.0 < abs(correlation) < 1.0


def test_frame_loop() -> None:
    lines = play("frame_loop").splitlines()
    assert len(lines) == 7
    assert numbers(lines[-1])[0] > 20


def test_own_recording() -> None:
    assert play("own_recording") == "5 of 5 frames OK\n"


def test_range_finder() -> None:
    status, error = play("range_finder").splitlines()
    assert status.startswith("OK after 6 frames")
    off, sigma = numbers(error)
    assert off < 0.05
    assert off < 4.0 * sigma

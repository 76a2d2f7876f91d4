"""What `collabslam-lab reproduce cue` hands over, on a trajectory of one look."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from collabslam.cli import BAD_INPUT
from collabslam_lab.cli import main as lab
from collabslam_lab.worn_cameras import cue
from collabslam_lab.worn_cameras.planned_views import FIRST, POLICIES, t_cf_error


def test_one_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cue, "QUICK_TRAJECTORIES", 1)
    monkeypatch.setattr(cue, "QUICK_FRAMES", FIRST + 1)
    assert lab.main(["reproduce", "cue", "--quick", "--jobs", "1", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "cue.md").read_text() in capsys.readouterr().out
    assert (tmp_path / "cue.png").read_bytes().startswith(b"\x89PNG")
    numbers = json.loads((tmp_path / "cue.json").read_text())
    assert numbers["gain_correlation"] > 0.5
    assert numbers["matches_correlation"] > 0.5
    assert 0.5 < numbers["matches_over_expected"] < 2.0
    assert set(numbers["error_m"]) == set(POLICIES)
    assert all(0.0 < error < 0.5 for error in numbers["error_m"].values())
    assert {"error_over_random", "error_over_best", "ms"} <= set(numbers)
    assert numbers["error_over"]["random"][0] == numbers["error_over_random"]
    rows = list(csv.DictReader((tmp_path / "cue.csv").read_text().splitlines()))
    assert len(rows) == numbers["views"] > 10
    # Views that find nothing gain nothing, and some find much.
    assert all(abs(float(row["gained"])) < 1e-9 for row in rows if float(row["matched"]) == 0.0)
    assert max(float(row["gained"]) for row in rows) > 0.2


def test_the_errors_of_six_ways_have_their_stated_size_in_every_direction() -> None:
    six, next_six = (
        np.array([t_cf_error(3, number, 5) for number in trajectories])
        for trajectories in (range(6), range(6, 12))
    )
    np.testing.assert_allclose(six.T @ six / 6.0, np.eye(6), atol=1e-12)
    assert np.abs(six - next_six).max() > 0.1
    assert np.abs(six[0] - t_cf_error(3, 0, 15)).max() > 0.1


def test_bad_numbers_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert lab.main(["reproduce", "cue", "--jobs", "0", "--out", str(tmp_path)]) == BAD_INPUT
    assert "give 1 job or more" in capsys.readouterr().err

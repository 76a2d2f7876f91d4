"""What `collabslam-lab reproduce cue` hands over, on a way of one look."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from collabslam.cli import BAD_INPUT
from collabslam_lab.cli import main as lab
from collabslam_lab.wearers import cue
from collabslam_lab.wearers.looking_way import FIRST, POLICIES


def test_one_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cue, "QUICK_WAYS", 1)
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
    rows = list(csv.DictReader((tmp_path / "cue.csv").read_text().splitlines()))
    assert len(rows) == numbers["views"] > 10
    # Views that find nothing gain nothing, and some find much.
    assert all(abs(float(row["gained"])) < 1e-9 for row in rows if float(row["matched"]) == 0.0)
    assert max(float(row["gained"]) for row in rows) > 0.2


def test_bad_numbers_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert lab.main(["reproduce", "cue", "--jobs", "0", "--out", str(tmp_path)]) == BAD_INPUT
    assert "give 1 job or more" in capsys.readouterr().err

"""What `collabslam-lab reproduce persons` hands over, on few runs and one short trajectory."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from collabslam_lab.cli import main as lab
from collabslam_lab.worn_cameras import persons
from collabslam_lab.worn_cameras.among_points import Variant, run_points


def test_few_runs_and_one_trajectory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(persons, "QUICK_RUNS", 2)
    monkeypatch.setattr(persons, "QUICK_TRAJECTORIES", 1)
    monkeypatch.setattr(persons, "QUICK_FRAMES", 7)
    assert lab.main(["reproduce", "persons", "--quick", "--jobs", "1", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "persons.md").read_text() in capsys.readouterr().out
    assert (tmp_path / "persons.png").read_bytes().startswith(b"\x89PNG")
    numbers = json.loads((tmp_path / "persons.json").read_text())
    for name in ("nees", "nees_one_tracker", "ms", "error_m"):
        assert set(numbers[name]) == {"1", "2", "3"}
        assert all(value > 0.0 for value in numbers[name].values())
    assert 0 <= numbers["trajectories_better_with_two"] <= numbers["trajectories"] == 1
    assert 0 <= numbers["trajectories_better_than_second"] + numbers["trajectories_better_than_either"] <= 2
    either = np.hypot(numbers["error_m"]["1"], numbers["error_of_second_m"])
    assert 0.0 < numbers["two_less_mean_of_both_m"] < numbers["error_m"]["2"] + either
    for count in ("1", "2", "3"):
        parts = numbers["error_by_images_m"][count], numbers["error_by_t_cf_m"][count]
        # Of two draws: each is the mean and half of the difference.
        assert parts[0] ** 2 + 0.5 * parts[1] ** 2 == pytest.approx(numbers["error_m"][count] ** 2, rel=1e-6)
    matches = [numbers["rendered"][count]["matches"] for count in ("1", "2", "3")]
    assert 5.0 < matches[0] < matches[1] < matches[2]
    (row,) = csv.DictReader((tmp_path / "persons.csv").read_text().splitlines())
    assert float(row["error_m_2"]) == pytest.approx(numbers["error_m"]["2"], rel=1e-4)


def test_what_a_filter_is_told_changes_what_it_says_and_not_what_it_sees() -> None:
    told, untold = (run_points(Variant(2, 0.7, share), 1, [0])[0] for share in (0.7, 0.0))
    assert np.isfinite(told.worn).sum() > 10
    assert (np.isfinite(told.worn) == np.isfinite(untold.worn)).all()
    assert np.nanmax(np.abs(told.pose - untold.pose)) > 0.1

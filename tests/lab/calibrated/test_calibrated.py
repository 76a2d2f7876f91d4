"""What `collabslam-lab reproduce calibration` hands over, and the errors that it puts into recordings."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from collabslam.cli import BAD_INPUT
from collabslam.datasets.worn_calibration import corrected
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.geometry import interpolate_pose, pose_inverse, rotation_log, se3_log
from collabslam.types import Array
from collabslam_lab.calibrated import draw, study
from collabslam_lab.calibrated.draw import Drawn
from collabslam_lab.calibrated.trajectories import WALKS, BendingWalk, Erring, EvenWalk, drawn_error, rendered
from collabslam_lab.cli import main as lab


def test_a_short_trajectory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(study, "WALKS", {"lively": WALKS["lively"]})
    monkeypatch.setattr(draw, "QUICK_FRAMES", 9)
    assert lab.main(["reproduce", "calibration", "--quick", "--jobs", "1", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "calibration.md").read_text() in capsys.readouterr().out
    assert (tmp_path / "calibration.png").read_bytes().startswith(b"\x89PNG")
    numbers = json.loads((tmp_path / "calibration.json").read_text())
    assert {"as it is", "while running", "views alone", "true poses"} == set(
        numbers["error_over_calibrated"]["lively"]
    )
    assert numbers["nees"]["lively"]["calibrated"] > 0.0
    rows = {
        row["kind"]: row for row in csv.DictReader((tmp_path / "calibration.csv").read_text().splitlines())
    }
    # A second of views tells the attitude already.
    left = np.array([float(rows["true poses"][f"off_{k}"]) for k in range(3, 6)])
    assert np.linalg.norm(left) < np.linalg.norm(drawn_error(0)[0][3:])


def test_ratios_are_over_the_same_draws() -> None:
    seven = np.full(7, 0.5)
    drawn = [
        Drawn("lively", 0, {"calibrated": 0.1, "as it is": 0.3, "true poses": 0.1},
              {"calibrated": 5.0, "as it is": 9.0, "true poses": 6.0}, {"true poses": seven},
              {"true poses": 2.0 * seven},
              {"true poses": 1}),
        Drawn("lively", 1, {"calibrated": 0.2, "as it is": 0.4}, {"calibrated": 7.0, "as it is": 9.0}),
    ]  # fmt: skip
    numbers = study.finding(drawn).numbers
    over = numbers["error_over_calibrated"]["lively"]
    assert over == {"as it is": pytest.approx(np.sqrt(0.25 / 0.05)), "true poses": pytest.approx(1.0)}
    assert numbers["nees"]["lively"] == {"calibrated": 6.0, "as it is": 9.0, "true poses": 6.0}
    assert numbers["correction_in_sd"]["lively"] == {"true poses": pytest.approx(0.5)}
    assert numbers["untold"]["lively"] == {"true poses": 1.0}


def test_a_rendered_way_errs_as_it_should() -> None:
    base = rendered("lively", 4, 0)
    error, clock = drawn_error(3)
    assert np.linalg.norm(error[:3]) == pytest.approx(0.03)
    assert np.degrees(np.linalg.norm(error[3:])) == pytest.approx(1.0)
    assert abs(clock) == 0.05
    here = Erring(base, error, clock).frame(2).views[0]
    then = base.worn_at(0.2 + clock, 2)
    assert then is not None
    assert here.t is None
    np.testing.assert_array_equal(here.image, then.image)
    np.testing.assert_allclose(corrected(then.t_cf, error), here.t_cf)


def test_another_recording_errs_in_t_cf_alone() -> None:
    base = WrappedRecording(rendered("lively", 4, 0))  # of which nothing can be rendered later
    here, now = Erring(base, np.zeros(6), 0.05).frame(1).views[0], base.frame(1).views[0]
    assert base.truth is not None
    np.testing.assert_array_equal(here.image, now.image)
    # Cf stands still in the world; Cs is half a frame further.
    half = interpolate_pose(base.truth[1], base.truth[2], 0.5)
    np.testing.assert_allclose(half @ here.t_cf, base.truth[1] @ now.t_cf, atol=1e-9)
    assert np.linalg.norm(here.t_cf[:3, 3] - now.t_cf[:3, 3]) > 0.03


@pytest.mark.parametrize("walk", [EvenWalk(), BendingWalk()])
def test_even_ways_are_even(walk: EvenWalk) -> None:
    def step(t: float) -> Array:
        return se3_log(pose_inverse(walk.robot(t)) @ walk.robot(t + 0.1))

    bound = pose_inverse(walk.robot(0.0)) @ walk.person(0.0)
    for t in (0.1, 1.3, 4.0):
        np.testing.assert_allclose(step(t), step(0.0), atol=1e-9)
        np.testing.assert_allclose(pose_inverse(walk.robot(t)) @ walk.person(t), bound, atol=1e-9)
    turned = np.linalg.norm(rotation_log((pose_inverse(walk.robot(0.0)) @ walk.robot(1.0))[:3, :3]))
    assert turned == pytest.approx(0.12 if isinstance(walk, BendingWalk) else 0.0, abs=1e-9)


def test_bad_numbers_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert lab.main(["reproduce", "calibration", "--jobs", "0", "--out", str(tmp_path)]) == BAD_INPUT
    assert "give 1 job or more" in capsys.readouterr().err

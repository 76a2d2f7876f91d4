"""What a run's diagnostics say about it, and what a new recording is given to begin with."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from collabslam import geometry as g
from collabslam.checks.doctor import diagnose
from collabslam.cli import main as cli
from collabslam.datasets import load_camera, open_recording
from collabslam.formats.landmarks import write_ply
from collabslam.formats.trajectory import write_covariances, write_tum
from collabslam.results import Landmarks
from collabslam.runs.folder import MARK
from collabslam.runs.run_folder import RunFolder
from collabslam.settings.table import Settings, schema

GOOD = {"status": "OK", "started": 1, "worn": 0, "predicted": 45, "searched": 40, "found": 36, "accepted": 35,
        "rejected_low_score": 3, "nis": 70, "nis_dof": 70}  # fmt: skip


def run(folder: Path, rows: list[dict[str, Any]], **summary: Any) -> list[str]:
    """Sentences about a run whose frames have these cells besides the good ones."""
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(MARK + "\n")
    (folder / "summary.json").write_text(json.dumps({"start": "worn", "scale_error": 0.01, **summary}))
    rows = [{"index": k, "t": 0.1 * k, **GOOD, **row} for k, row in enumerate(rows)]
    with (folder / "frames.csv").open("w", newline="") as lines:
        writer = csv.DictWriter(lines, sorted({key for row in rows for key in row}))
        writer.writeheader()
        writer.writerows(rows)
    return diagnose(RunFolder(folder))


def many(count: int = 30, **cells: Any) -> list[dict[str, Any]]:
    return [dict(cells) for _ in range(count)]


WORN = {"worn": 1, "overlap": 1, "cf_points": 100, "cf_matches": 30}


@pytest.mark.parametrize(
    ("rows", "summary", "words"),
    [
        (many(), {}, "Nothing is wrong"),
        (many(started=0), {}, "no frame has a view of it"),
        (many(started=0, worn=1), {}, "never overlap"),
        (many(started=0, **{**WORN, "cf_matches": 3}), {}, "at most 3 points match"),
        (many(started=0), {"start": "scale-free"}, "not only turn"),
        (many(started=0), {"start": "target"}, "never started from 'target'"),
        (many(20) + many(5, status="COASTING") + many(5, status="LOST"), {}, "lost from frame 25 on (2.5 s)"),
        (many(25) + many(5, status="COASTING"), {}, "In 5 of 30 frames"),
        (many(degraded_by="moving"), {}, "30 frames are not to be trusted: new points do not move"),
        (many(degraded_by="cf_matches"), {}, "30 frames are not to be trusted: points of the map"),
        (many(degraded_by="size"), {}, "depths are in another unit (--depth-scale)"),
        (many(), {"start": "depth", "scale_error": 4.0}, "Its depths may be in another unit"),
        (many(predicted=9), {}, "The map is thin: 9 features"),
        (many(candidates_fixed=2), {}, "60 points turn with the camera"),
        (many(left_out_pct=20, wearers=1), {}, "20 % of the image was left out in the mean of 30 frames"),
        (many(10) + many(5, wearers_unseen=1), {}, "In 5 frames (1.0 to 1.4 s) the scene shows where"),
        (many(rejected_low_score=20), {}, "50 % of the features searched look different"),
        (many(rejected_ambiguous=16), {}, "40 % of the features searched are ambiguous"),
        (many(rejected_hohct=8), {}, "20 % of the features searched are found where"),
        (many(nis=210), {}, "The innovations are 3.0 times as large"),
        ([{"t": 0.1 * k + (2.0 if k > 9 else 0.0)} for k in range(30)], {}, "the longest of 2.10 s"),
        (many(worn=1), {}, "never overlapped"),
        (many(**WORN) + many(4) + many(12, **{**WORN, "cf_matches": 0}), {}, "12 overlapping views in a row"),
        (many(9, **{**WORN, "cf_matches": 0}) + many(**WORN), {}, "Nothing is wrong"),
        (many(**{**WORN, "cf_matches": 2, "cf_rejected_epipolar": 80}), {}, "near the epipolar line"),
        (many(**WORN, t_cf_correction_m=0.12, t_cf_correction_deg=4.0, t_cf_against=1.2), {},
         "they move it by 12.0 cm and 4.0 degrees"),
        (many(9, **WORN) + many(**WORN, t_cf_length_doubt=0.14), {}, "up to 14 %, first seen in frame 9"),
        (many(**WORN), {"scale_error": -0.2}, "off by -20 % against the truth, in spite of overlap"),
        (many(), {"metric": False}, "arbitrary unit"),
    ],
)  # fmt: skip
def test_the_doctor_names_the_fault(
    tmp_path: Path, rows: list[dict[str, Any]], summary: dict[str, Any], words: str
) -> None:
    sentences = run(tmp_path / "run", rows, **summary)
    assert any(words in s for s in sentences), sentences
    assert all(s.endswith((".", "; see the next lines.")) for s in sentences)


def test_the_doctor_has_something_to_say_of_any_run(tmp_path: Path) -> None:
    assert run(tmp_path / "run", many(nis=210))[0].startswith("The innovations are 3.0 times")
    assert cli.main(["doctor", str(tmp_path)]) == 2
    assert run(tmp_path / "empty", []) == ["The run has no frames: nothing was estimated."]


def images(folder: Path) -> None:
    folder.mkdir()
    for k in range(3):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((24, 32), 40 * k, np.uint8))


def test_init_writes_what_a_run_needs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    images(tmp_path / "walk")
    assert cli.main(["init", str(tmp_path / "walk"), "--out", str(tmp_path / "new")]) == 0
    shown = capsys.readouterr().out
    assert "are a guess" in shown
    assert "collabslam run" in shown
    assert Settings.load(tmp_path / "new" / "settings.yaml") == Settings.default()
    recording = open_recording(tmp_path / "walk", camera=tmp_path / "new" / "camera.yaml")
    assert recording.camera.width == 32
    assert recording.image(1)[0, 0] == 40
    assert cli.main(["init", str(tmp_path / "walk"), "--out", str(tmp_path / "new")]) == 2
    assert "exists already" in capsys.readouterr().err


def test_init_keeps_a_calibration_that_is_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    images(tmp_path / "walk")
    camera = tmp_path / "mine.yaml"
    camera.write_text("resolution: [32, 24]\nintrinsics: [30, 31, 15, 11]\ndistortion_model: equidistant\n"
                      "distortion_coefficients: [0.1, 0.0, 0.0, 0.01]\nrate: 5\n")  # fmt: skip
    out = tmp_path / "new"
    assert cli.main(["init", str(tmp_path / "walk"), "--camera", str(camera), "--out", str(out)]) == 0
    assert "guess" not in capsys.readouterr().out
    assert load_camera(out / "camera.yaml") == load_camera(camera)
    assert cli.main(["init", str(tmp_path / "nowhere"), "--out", str(out / "x")]) == 2


def test_settings_docs_hold_every_setting(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["settings", "docs"]) == 0
    text = capsys.readouterr().out
    for key, entry in schema().items():
        assert f"`{key.rpartition('.')[2]}`" in text
        assert entry.doc in text


@pytest.mark.parametrize("moves", [False, True])
def test_a_camera_that_only_turns_is_told(tmp_path: Path, moves: bool) -> None:
    """It sees points at two metres; it turns by two degrees a frame, and maybe goes 10 cm."""
    turns = [g.rotation_exp([0.0, 0.035 * k, 0.0]) for k in range(30)]
    poses = np.array([g.pose(turn, [0.1 * k * moves, 0.0, 0.0]) for k, turn in enumerate(turns)])
    points = np.array([[0.5 * k - 2.0, 0.0, 2.0] for k in range(9)])
    folder, times = tmp_path / "run", 0.1 * np.arange(30)
    run(folder, many(20) + many(10, status="DEGRADED", degraded_by="moving"), start="scale-free")
    write_tum(folder / "trajectory.tum", times, poses)
    write_covariances(folder / "trajectory.cov", times, np.array([np.eye(6)] * 30))
    write_ply(folder / "map.ply", Landmarks(np.arange(9), points, np.array([np.eye(3)] * 9)))
    assert ("only turned: 58 degrees" in diagnose(RunFolder(folder))[0]) != moves

"""Result files: formats, atomic writing, and that nothing foreign is overwritten."""

from __future__ import annotations

import csv
import json
import os
import resource
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from helpers.stand_ins import step_result

from collabslam import geometry as g
from collabslam.errors import DataError
from collabslam.evaluation.record import RunRecord
from collabslam.formats.files import LineFile
from collabslam.formats.landmarks import write_ply
from collabslam.results import Landmarks, StepResult, SubmapPoses
from collabslam.runs import results
from collabslam.runs.folder import MARK, claim, locked
from collabslam.types import Status

CONFIG = MARK + ": test\n"


def landmarks(count: int = 5) -> Landmarks:
    points = np.arange(3.0 * count).reshape(count, 3)
    return Landmarks(np.arange(count), points, np.tile(np.diag([1.0, 4.0, 9.0]), (count, 1, 1)))


def step(k: int, valid: bool = True) -> StepResult:
    return step_result(
        1.5e9 + 0.1 * k,
        g.se3_exp([0.1 * k, 0.0, 0.2 * k, 0.0, 0.1 * k, 0.0]),
        np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) * 1e-4 + 1e-5,
        {"accepted": 12 + k, "nis": np.float64(3.25), "overlap": True, "own_number": 7},
        Status.OK if valid else Status.LOST,
    )


def submap_poses(record: RunRecord) -> SubmapPoses:
    """The first two frames, the second a metre farther along x than the filter had it."""
    poses = record.poses[:2].copy()
    poses[1, 0, 3] += 1.0
    return SubmapPoses(record.times[:2], poses, record.covariances[:2], record.poses[:2], [], landmarks())


def write(folder: Path, frames: int = 4) -> RunRecord:
    record = RunRecord()
    with results.ResultWriter(folder, CONFIG) as writer:
        for k in range(frames):
            record.append(step(k, valid=k != 2), worn=k % 2 == 0, seconds=0.01)
            writer.frame(record)
        truth = record.poses.copy()
        truth[1] = np.nan
        writer.finish(
            record,
            landmarks(),
            truth,
            {"mode": "mono", "ate_rmse_m": float("nan"), "n": np.int64(3)},
            submap_poses(record),
        )
    return record


def numbers(path: Path) -> np.ndarray:
    return np.loadtxt(path, comments="#", ndmin=2)


def test_a_run_writes_every_file(tmp_path: Path) -> None:
    write(tmp_path)
    # There are no inertial sensors.
    of_sensors = {results.LEVEL_TRAJECTORY, results.LEVEL_COVARIANCE, results.LEVEL_MAP, results.RATE_POSES}
    expected = set(results.RESULT_FILES) - {results.PICTURE} - of_sensors
    assert {p.name for p in tmp_path.iterdir()} == expected


def test_trajectory_holds_the_valid_poses_in_tum_order(tmp_path: Path) -> None:
    record = write(tmp_path)
    rows = numbers(tmp_path / "trajectory.tum")
    assert rows.shape == (3, 8)
    assert np.all(np.diff(rows[:, 0]) > 0)
    np.testing.assert_allclose(rows[2, 1:4], record.poses[3, :3, 3], atol=1e-8)
    x, y, z, w = rows[2, 4:]
    np.testing.assert_allclose(g.pose_from_quaternion(rows[2, 1:4], [w, x, y, z]), record.poses[3], atol=1e-8)
    assert len(numbers(tmp_path / "groundtruth.tum")) == 3


def test_loops_correct_what_follows_the_submap_that_they_move(tmp_path: Path) -> None:
    record = write(tmp_path)
    corrected, rows = (numbers(tmp_path / name) for name in ("corrected.tum", "trajectory.tum"))
    moved = rows[:, 1:4] + np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(corrected[:, 1:4], moved, atol=1e-8)
    ends = record.poses[:2, :3, 3] + np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    np.testing.assert_allclose(numbers(tmp_path / "submaps.tum")[:, 1:4], ends, atol=1e-8)
    assert numbers(tmp_path / "submaps.cov").shape == (2, 22)
    assert (tmp_path / "whole_map.ply").read_bytes() == (tmp_path / "map.ply").read_bytes()


def test_covariances_are_lower_triangles_matched_to_the_poses(tmp_path: Path) -> None:
    record = write(tmp_path)
    rows = numbers(tmp_path / "trajectory.cov")
    assert rows.shape == (3, 22)
    np.testing.assert_array_equal(rows[:, 0], numbers(tmp_path / "trajectory.tum")[:, 0])
    matrix = np.zeros((6, 6))
    matrix[np.tril_indices(6)] = rows[0, 1:]
    np.testing.assert_allclose(np.tril(record.covariances[0]), matrix, rtol=1e-12)
    assert "#%TANGENT_CONVENTION right_perturbation" in (tmp_path / "trajectory.cov").read_text()


def test_frames_hold_every_frame_with_pose_and_flags(tmp_path: Path) -> None:
    write(tmp_path)
    with (tmp_path / "frames.csv").open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert [r["status"] for r in rows] == ["OK", "OK", "LOST", "OK"]
    assert [r["valid"] for r in rows] == ["1", "1", "0", "1"]
    assert rows[3]["accepted"] == "15"
    assert rows[3]["nis"] == "3.25"
    assert rows[0]["searched"] == ""
    assert rows[0]["overlap"] == "1"
    assert rows[0]["own_number"] == "7"
    assert float(rows[2]["z"]) == pytest.approx(0.4)
    assert set(results.DIAGNOSTICS) <= set(rows[0])


def test_a_crash_keeps_the_frames_so_far(tmp_path: Path) -> None:
    record = RunRecord()

    def crash() -> None:
        with results.ResultWriter(tmp_path, CONFIG) as writer:
            record.append(step(0), worn=False, seconds=0.0)
            writer.frame(record)
            assert len((tmp_path / "frames.csv").read_text().splitlines()) == 2
            raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        crash()
    assert numbers(tmp_path / "trajectory.tum").shape == (1, 8)


def test_summary_is_sorted_json_with_null_for_nan(tmp_path: Path) -> None:
    write(tmp_path)
    text = (tmp_path / "summary.json").read_text()
    assert json.loads(text) == {"ate_rmse_m": None, "mode": "mono", "n": 3}
    assert text.index("ate_rmse_m") < text.index("mode")


def test_map_is_a_ply_with_uncertainty(tmp_path: Path) -> None:
    write(tmp_path)
    data = (tmp_path / "map.ply").read_bytes()
    header, body = data.split(b"end_header\n", 1)
    assert b"element vertex 5" in header
    names = [line.split()[2].decode() for line in header.splitlines() if line.startswith(b"property")]
    codes = {b"double": "<f8", b"float": "<f4", b"int": "<i4"}
    kinds = [codes[line.split()[1]] for line in header.splitlines() if line.startswith(b"property")]
    table = np.frombuffer(body, dtype=list(zip(names, kinds, strict=True)))
    np.testing.assert_allclose(table["z"], landmarks().points[:, 2])
    np.testing.assert_allclose(table["sigma_y"], 2.0)
    np.testing.assert_allclose(table["cov_zz"], 9.0)
    assert table["id"].tolist() == [0, 1, 2, 3, 4]


def test_an_earlier_result_is_replaced_and_other_files_stay(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "trajectory.png").write_text("old")
    with results.ResultWriter(tmp_path, CONFIG):
        assert not (tmp_path / "summary.json").exists()
        assert not (tmp_path / "trajectory.png").exists()
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_folder_with_other_things_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("mine: 1\n")
    for overwrite in (False, True):
        with ExitStack() as stack, pytest.raises(DataError, match="--out"):
            claim(tmp_path, stack, overwrite=overwrite)
    assert (tmp_path / "config.yaml").read_text() == "mine: 1\n"
    with ExitStack() as stack, pytest.raises(DataError, match="cannot be written"):
        claim(tmp_path / "config.yaml", stack, overwrite=False)


def test_earlier_results_are_kept_in_folders_with_numbers(tmp_path: Path) -> None:
    for expected in ("walk", "walk-2", "walk-3"):
        with ExitStack() as stack:
            folder = claim(tmp_path / "walk", stack, overwrite=False)
            assert folder == tmp_path / expected
            assert (tmp_path / "latest").readlink() == Path(expected)
            write(folder)
    with ExitStack() as stack:
        assert claim(tmp_path / "latest", stack, overwrite=True) == tmp_path / "walk-3"
    with ExitStack() as stack:
        assert claim(tmp_path / "walk", stack, overwrite=True) == tmp_path / "walk"
        assert (tmp_path / "latest").readlink() == Path("walk")


def test_a_link_or_file_that_is_not_ours_stays(tmp_path: Path) -> None:
    for k, make in enumerate((lambda p: p.write_text("mine"), lambda p: p.symlink_to("/nowhere/else"))):
        place = tmp_path / str(k)
        place.mkdir()
        make(place / "latest")
        before = os.readlink(place / "latest") if k else (place / "latest").read_text()
        with ExitStack() as stack:
            claim(place / "walk", stack, overwrite=False)
        assert (os.readlink(place / "latest") if k else (place / "latest").read_text()) == before


def test_two_runs_never_write_into_one_folder(tmp_path: Path) -> None:
    with ExitStack() as stack:
        folder = claim(tmp_path / "walk", stack, overwrite=False)
        write(folder)
        for overwrite in (False, True):
            with ExitStack() as other, pytest.raises(DataError, match="Another run is writing"):
                claim(tmp_path / "walk", other, overwrite=overwrite)
    with locked(folder):
        pass


def test_the_lock_of_a_killed_process_is_gone(tmp_path: Path) -> None:
    code = (
        "import sys, time; from contextlib import ExitStack; from pathlib import Path\n"
        "from collabslam.runs.folder import claim\n"
        "with ExitStack() as s:\n"
        "    claim(Path(sys.argv[1]), s, overwrite=False); print('in', flush=True); time.sleep(60)"
    )
    process = subprocess.Popen([sys.executable, "-c", code, tmp_path / "walk"], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"in\n"
    with ExitStack() as stack, pytest.raises(DataError, match="Another run"):
        claim(tmp_path / "walk", stack, overwrite=False)
    process.kill()
    process.communicate()
    with ExitStack() as stack:
        assert claim(tmp_path / "walk", stack, overwrite=False) == tmp_path / "walk"


def test_a_full_disk_tears_no_line(tmp_path: Path) -> None:
    """A limit on the size of files stands in for the disk: it takes a part of a line, then refuses."""
    path = tmp_path / "lines.txt"
    path.touch()
    lines = LineFile(path)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (105, limits[1]))
    try:
        for _ in range(10):
            lines.append("123456789")
        with pytest.raises(DataError, match="disk space"):
            lines.append("123456789")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert path.read_text() == "123456789\n" * 10
    lines.append("goes on")
    lines.close()
    assert path.read_text().endswith("123456789\ngoes on\n")


def test_runs_without_a_valid_pose_write_empty_trajectories(tmp_path: Path) -> None:
    record = RunRecord()
    record.append(step(0, valid=False), worn=False, seconds=0.0)
    results.write_trajectory(tmp_path, record)
    assert all(line.startswith("#") for line in (tmp_path / "trajectory.tum").read_text().splitlines())
    write_ply(tmp_path / "map.ply", landmarks(0))
    assert b"element vertex 0" in (tmp_path / "map.ply").read_bytes()


def test_what_comes_out_prints_in_a_few_lines() -> None:
    record = RunRecord()
    for k in range(3):
        record.append(step(k), worn=True, seconds=0.01)
    said = repr(step(1))
    assert said.splitlines()[0] == "StepResult at 1500000000.100000 s: OK"
    assert "position 0.100 0.000 0.200 m, known to 0.02" in said
    assert (
        repr(landmarks()) == "Landmarks(ids=int64 (5,), points=float64 (5, 3), covariance=float64 (5, 3, 3))"
    )
    for shown in (step(1), step(1, valid=False), record, submap_poses(record), landmarks()):
        lines = repr(shown).splitlines()
        assert len(lines) <= 10
        assert max(map(len, lines)) <= 240

"""Which way is down: by an accelerometer at rest and on the way, as told; results in a level world."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.clip import Clip
from helpers.gyro import R_CI, Turned, of_clip
from helpers.level import SETTINGS, UP, off, recorded

from collabslam import SettingsError, run
from collabslam.cli import main as cli
from collabslam.datasets import write_recording
from collabslam.geometry import pose, rotation_exp, rotation_log, skew
from collabslam.level import GRAVITY, Level
from collabslam.runs.level import measured_level, parse_world
from collabslam.runs.plan import Output
from collabslam.runs.run_folder import RunFolder
from collabslam.slam import level_estimator
from collabslam.types import Imu


@pytest.mark.parametrize(("moving", "how"), [(0.0, "at rest over 12.0"), (1.0, "in the mean over 12.0")])
@pytest.mark.parametrize("metric", [True, False])
def test_an_accelerometer_tells_up(moving: float, how: str, metric: bool) -> None:
    record, log = recorded(moving)
    found = measured_level(record, log, SETTINGS, metric=metric)  # type: ignore[arg-type]
    assert found is not None
    assert how in found.source
    sd = np.sqrt(found.covariance[0, 0])
    assert off(found) < 3.0 * sd
    assert off(found) < np.deg2rad(0.5 if metric or not moving else 3.0)
    assert sd < np.deg2rad(1.0 if metric or not moving else 3.0)


def test_what_is_not_known_is_in_its_covariance() -> None:
    record, log = recorded(0.0)
    least = measured_level(record, log, SETTINGS, metric=True)  # type: ignore[arg-type]
    assert least is not None
    assert np.sqrt(least.covariance[0, 0]) == pytest.approx(np.hypot(0.058 / GRAVITY, 1e-3), rel=0.2)
    drifted, _ = recorded(0.0, drift=np.deg2rad(2.0) ** 2)
    more = measured_level(drifted, log, SETTINGS, metric=True)  # type: ignore[arg-type]
    assert more is not None
    assert np.sqrt(more.covariance[0, 0]) > np.deg2rad(2.0)
    bare = replace(log, sensor=Imu(R_CI))
    default = measured_level(record, bare, SETTINGS, metric=True)  # type: ignore[arg-type]
    assert default is not None
    assert default.covariance[0, 0] >= (SETTINGS.filter.imu.accel_bias_sd / GRAVITY) ** 2
    off_by = np.array([0.05, -0.05, 0.05])
    biased, wrong = recorded(0.0, bias=off_by)
    found = measured_level(biased, wrong, SETTINGS, metric=True)  # type: ignore[arg-type]
    assert found is not None
    assert 0.5 < off(found) / np.sqrt(found.covariance[0, 0]) < 3.0


def test_nothing_is_said_where_nothing_tells_it() -> None:
    record, log = recorded(1.0, seconds=3.0)  # too short a way
    assert measured_level(record, log, SETTINGS, metric=True) is None  # type: ignore[arg-type]
    record, log = recorded(0.0)
    assert measured_level(record, None, SETTINGS, metric=True) is None  # type: ignore[arg-type]
    none = replace(log, accelerations=None)
    assert measured_level(record, none, SETTINGS, metric=True) is None  # type: ignore[arg-type]
    assert log.accelerations is not None
    weak = replace(log, accelerations=0.8 * log.accelerations)
    assert measured_level(record, weak, SETTINGS, metric=True) is None  # type: ignore[arg-type]
    later = replace(log, times=log.times + 100.0)
    assert measured_level(record, later, SETTINGS, metric=True) is None  # type: ignore[arg-type]


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.0, 10.0), (-20.0, 30.0), (5.0, -80.0)])
def test_roll_and_pitch_may_be_told(roll: float, pitch: float) -> None:
    found = parse_world(f"level:{roll},{pitch}")
    assert found is not None
    numbers = found.numbers()
    assert numbers["roll_deg"] == pytest.approx(roll, abs=1e-9)
    assert numbers["pitch_deg"] == pytest.approx(pitch, abs=1e-9)
    assert numbers["sd_deg"] == pytest.approx(1.0)
    turn = found.r_lw
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    np.testing.assert_allclose(turn @ found.up, [0.0, 0.0, 1.0], atol=1e-12)
    ahead = turn @ [0.0, 0.0, 1.0]
    assert ahead[1] == pytest.approx(0.0, abs=1e-12)
    assert ahead[0] >= 0.0
    assert ahead[2] == pytest.approx(-np.sin(np.deg2rad(pitch)))


def test_what_is_told_is_checked() -> None:
    assert parse_world("level") is None
    with_sd = parse_world("level:0,0,2")
    assert with_sd is not None
    assert with_sd.numbers()["sd_deg"] == pytest.approx(2.0)
    for text in ("flat", "level:1", "level:a,b", "level:nan,0", "level:0,0,0", "level:1,2,3,4"):
        with pytest.raises(SettingsError):
            parse_world(text)


def test_a_pose_has_the_covariance_of_its_level() -> None:
    """As drawn levels scatter it."""
    found = Level(UP, np.diag([0.01, 0.02]) ** 2, "told")
    t_wc = pose(rotation_exp([0.3, 0.5, -0.2]), [4.0, -1.0, 7.0])
    moved, covariances = found.poses(t_wc[None], 1e-10 * np.eye(6)[None])
    seen = np.array([[3.0, 1.0, 8.0]])
    points, spreads = found.points(seen, 1e-10 * np.eye(3)[None])
    generator, errors, places = np.random.default_rng(4), [], []
    for _ in range(4000):
        turn = rotation_exp([*(np.sqrt(np.diag(found.covariance)) * generator.standard_normal(2)), 0.0])
        true = pose(turn, np.zeros(3)) @ moved[0]
        step = np.linalg.inv(moved[0]) @ true
        errors.append([*step[:3, 3], *rotation_log(step[:3, :3])])
        places.append(turn @ points[0] - points[0])
    np.testing.assert_allclose(np.cov(np.array(errors).T), covariances[0], atol=4e-4)
    np.testing.assert_allclose(np.cov(np.array(places).T), spreads[0], atol=4e-4)
    np.testing.assert_allclose(points[0], found.r_lw @ seen[0])
    assert np.abs(skew(found.up) @ found.up).max() < 1e-12


def test_a_run_writes_a_level_world(clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(level_estimator, "LEAST_WAY", 0.5)
    log = of_clip(clip)
    true = [clip.recording.robot(float(t))[:3, :3].T @ [0.0, 0.0, 1.0] for t in log.times]
    still = replace(log, accelerations=GRAVITY * np.array(true) @ R_CI)
    write_recording(Turned(clip, still), tmp_path / "walk")
    result = run(tmp_path / "walk", out=Output(tmp_path / "out", world="level"))
    assert result.level is not None
    assert np.rad2deg(off(result.level, true[np.argmin(np.abs(log.times))])) < 3.0
    folder = RunFolder(tmp_path / "out")
    times, poses, covariances = folder.level_trajectory()
    plain = folder.trajectory()
    np.testing.assert_array_equal(times, plain[0])
    np.testing.assert_allclose(poses[:, :3, 3], plain[1][:, :3, 3] @ result.level.r_lw.T, atol=1e-6)
    assert (np.trace(covariances, axis1=1, axis2=2) > np.trace(plain[2], axis1=1, axis2=2)).all()
    assert len(folder.level_landmarks().ids) == len(folder.landmarks().ids)
    numbers = json.loads((tmp_path / "out" / "summary.json").read_text())["level"]
    assert numbers["source"].startswith("accelerometer")
    for kind, name in (("euroc", "level.csv"), ("csv", "points.csv"), ("ros2", "bag")):
        words = ["export", str(tmp_path / "out"), str(tmp_path / name), "--format", kind, "--world", "level"]
        assert cli.main(words) == 0
    first = (tmp_path / "level.csv").read_text().splitlines()[-1].split(",")
    np.testing.assert_allclose([float(x) for x in first[1:4]], poses[-1, :3, 3], atol=1e-6)


def test_a_run_that_nothing_tells_it_is_refused(
    clip: Clip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SettingsError, match=r"no accelerometer.*level:ROLL,PITCH"):
        run(Turned(clip, of_clip(clip)), out=Output(tmp_path / "none", world="level"))
    told = run(Turned(clip, None), out=Output(tmp_path / "told", world="level:0,0"))
    assert told.level is not None
    assert told.summary["level"]["pitch_deg"] == pytest.approx(0.0, abs=1e-9)
    plain = run(Turned(clip, None), out=tmp_path / "plain")
    assert plain.level is None
    assert plain.summary["level"] is None
    assert not (tmp_path / "plain" / "level.tum").exists()
    words = ["export", str(tmp_path / "plain"), str(tmp_path / "x"), "--format", "csv", "--world", "level"]
    assert cli.main(words) == 2
    assert "run the recording with --world level" in capsys.readouterr().err

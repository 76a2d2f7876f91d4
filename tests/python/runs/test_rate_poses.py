"""Poses between frames at the rate of a gyroscope: as the camera really went, with the covariance for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clip import Clip
from helpers.gyro import BIAS, R_CI, Turned, of_clip

from collabslam import Settings, SettingsError, run
from collabslam.cli import main as cli
from collabslam.datasets import write_recording
from collabslam.geometry import pose, pose_inverse, rotation_exp, rotation_log
from collabslam.runs.plan import Output
from collabslam.runs.rate_poses import RatePose, rate_poses
from collabslam.types import Array, Imu, ImuLog

SETTINGS = Settings.default()
FRAMES, RATE, OFFSET = 15, 200, 0.004


def true(t: float) -> Array:
    turn = rotation_exp([0.4 * np.sin(2.0 * t), 0.0, 0.0]) @ rotation_exp(
        [0.0, 0.9 * np.sin(1.3 * t), 0.1 * t]
    )
    return pose(turn, [np.sin(1.1 * t), 0.2 * t, 0.5 * np.cos(0.8 * t)])


def recorded(error: float = 0.0) -> tuple[SimpleNamespace, ImuLog]:
    """Frames and samples of that way; each frame's pose is off by an error of its own."""
    times = np.arange(0.0, 4.0, 1.0 / FRAMES)
    generator, exact = np.random.default_rng(3), np.array([true(t) for t in times])
    off = error * generator.standard_normal((len(times), 6))
    poses = np.array([p @ pose(rotation_exp(x[3:]), x[:3]) for p, x in zip(exact, off, strict=True)])
    stamps, half = np.arange(-0.1, 4.2, 1.0 / RATE), 1e-4
    rates = [rotation_log(true(t - half)[:3, :3].T @ true(t + half)[:3, :3]) / (2 * half) for t in stamps]
    noise = 0.002 * np.sqrt(RATE) * generator.standard_normal((len(stamps), 3))
    log = ImuLog(
        stamps - OFFSET,
        np.array(rates) @ R_CI + BIAS + noise,
        None,
        Imu(R_CI, gyro_noise=0.002, time_offset=OFFSET),
    )
    record = SimpleNamespace(
        times=times,
        poses=poses,
        covariances=np.tile(max(error, 1e-5) ** 2 * np.eye(6), (len(times), 1, 1)),
        valid=np.ones(len(times), np.bool_),
    )
    return record, log


def found_in(record: SimpleNamespace, log: ImuLog) -> list[RatePose]:
    return list(rate_poses(record, log, SETTINGS, BIAS, OFFSET))  # type: ignore[arg-type]


def test_they_go_as_the_camera_went() -> None:
    found = found_in(*recorded())
    assert len(found) > 0.85 * RATE * 3.9
    errors = [pose_inverse(true(one.t)) @ one.pose for one in found]
    assert max(np.linalg.norm(e[:3, 3]) for e in errors) < 2e-3
    assert np.rad2deg(max(np.linalg.norm(rotation_log(e[:3, :3])) for e in errors)) < 0.15
    for one in found[::50]:
        way = (true(one.t + 1e-4)[:3, 3] - true(one.t - 1e-4)[:3, 3]) / 2e-4
        np.testing.assert_allclose(one.velocity, way, atol=0.05)
        turn = rotation_log(true(one.t - 1e-4)[:3, :3].T @ true(one.t + 1e-4)[:3, :3]) / 2e-4
        np.testing.assert_allclose(one.angular_velocity, turn, atol=0.15)


def test_their_covariance_is_no_less_than_their_error() -> None:
    found = found_in(*recorded(error=0.01))
    squares = []
    for one in found:
        step = pose_inverse(true(one.t)) @ one.pose
        error = np.concatenate([step[:3, 3], rotation_log(step[:3, :3])])
        squares.append(error @ np.linalg.solve(one.covariance, error))
    assert 1.5 < np.mean(squares) < 6.5  # errors of frames that are not alike cancel between them


def test_nothing_is_said_over_gaps() -> None:
    record, log = recorded()
    record.valid[20:25] = False
    kept = ~((log.times > 2.5) & (log.times < 2.8))
    times = np.array(
        [one.t for one in found_in(record, replace(log, times=log.times[kept], rates=log.rates[kept]))]
    )
    assert not ((times > record.times[19] + 1e-9) & (times < record.times[25] - 1e-9)).any()
    assert not ((times > 2.53) & (times < 2.8)).any()
    assert (times < 2.5).sum() > 300


def test_a_run_writes_them(clip: Clip, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_recording(Turned(clip, of_clip(clip)), tmp_path / "walk")
    assert cli.main(["run", str(tmp_path / "walk"), "--rate-poses", "--out", str(tmp_path / "out")]) == 0
    rows = np.loadtxt(tmp_path / "out" / "poses_imu_rate.csv", delimiter=",", skiprows=3)
    assert rows.shape[1] == 1 + 7 + 6 + 21
    assert len(rows) > 0.8 * RATE * (clip.frames[-1].t - clip.frames[0].t)
    assert (np.diff(rows[:, 0]) > 0.0).all()
    assert "metres" in (tmp_path / "out" / "poses_imu_rate.csv").read_text().splitlines()[0]
    w = clip.recording.truth[0]
    for row in rows[::40]:
        way = pose_inverse(w) @ clip.recording.robot(float(row[0]))
        np.testing.assert_allclose(row[1:4], way[:3, 3], atol=0.1)
    with pytest.raises(SettingsError, match="no gyroscope at whose rate"):
        run(Turned(clip, None), out=Output(tmp_path / "none", rate_poses=True))

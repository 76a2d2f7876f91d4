"""A gyroscope held against the turns of images: mount, clock, bias, and the mistakes that are named."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clip import Clip
from helpers.gyro import BIAS, R_CI, Turned

from collabslam import RecordingWriter
from collabslam.checks import gyroscope
from collabslam.checks.calibration import CalibrationReport
from collabslam.checks.gyro_fit import Integrated, Turns
from collabslam.checks.gyroscope import (
    GyroReport,
    check_gyroscope,
    check_worn_gyroscopes,
    image_turns,
    worn_turns,
)
from collabslam.checks.matching import Matches
from collabslam.checks.mistakes import MirroredCamera
from collabslam.checks.relative_motion import relative_motion
from collabslam.checks.wheels import PARALLAX
from collabslam.cli import main as cli
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.geometry import pose_inverse, rotation_exp, rotation_log, se3_exp
from collabslam.types import Array, Frame, Imu, ImuLog

RATE = 200.0
TIMES = np.arange(0.0, 20.0, 1.0 / RATE)


def swings(t: Array) -> Array:
    """Angular velocity along the axes of C, rad/s."""
    return np.stack(
        [0.6 * np.sin(1.7 * t) + 0.2, 0.5 * np.sin(2.9 * t + 1.0), 0.7 * np.sin(1.1 * t + 2.0)], axis=-1
    )


def log_of(rates: Array, sensor: Imu | None = None, times: Array = TIMES) -> ImuLog:
    return ImuLog(times, rates, None, sensor or Imu(R_CI))


def sensed(noise: float = 0.01) -> Array:
    generator = np.random.default_rng(5)
    return swings(TIMES) @ R_CI + BIAS + noise * generator.standard_normal((len(TIMES), 3))


def turns(axes: Array | None = None, noise: float = np.deg2rad(0.05)) -> Turns:
    """What images would say of pairs of frames, two of them wrong; about given axes alone."""
    rates = swings(TIMES) if axes is None else swings(TIMES) * axes
    integrated, generator = Integrated(log_of(rates)), np.random.default_rng(6)
    first = np.sort(generator.uniform(1.0, 18.0, 48))
    second = first + np.where(np.arange(48) % 2, 0.1, 0.3)
    vectors, _, known = integrated.between(first, second)
    assert known.all()
    vectors = vectors + noise * generator.standard_normal(vectors.shape)
    vectors[[7, 31]] += 0.2
    return Turns(first, second, vectors)


def checked(log: ImuLog, monkeypatch: pytest.MonkeyPatch, seen: Turns | None = None) -> GyroReport:
    monkeypatch.setattr(gyroscope, "image_turns", lambda _: seen or turns())

    class Recording:
        imu = log

    report = check_gyroscope(Recording())  # type: ignore[arg-type]
    assert report is not None
    return report


def off(report: GyroReport, r_ci: Array) -> float:
    assert report.sensor is not None
    return float(np.rad2deg(np.linalg.norm(rotation_log(report.sensor.r_ci @ r_ci.T))))


@pytest.mark.parametrize("late", [0.0, 0.03, -2.5])
def test_mount_clock_and_bias_are_found(monkeypatch: pytest.MonkeyPatch, late: float) -> None:
    sensor = Imu(rotation_exp([0.0, 0.3, 0.0]) @ R_CI, gyro_noise=0.002)
    report = checked(log_of(sensed(), sensor, TIMES + late), monkeypatch)
    assert off(report, R_CI) < 0.3
    assert report.sensor is not None
    assert report.fit is not None
    assert report.sensor.mount_sd is not None
    assert np.deg2rad(off(report, R_CI)) < 3.0 * report.sensor.mount_sd
    assert report.sensor.time_offset == pytest.approx(-late, abs=2e-3)
    assert report.sensor.gyro_noise == 0.002
    np.testing.assert_allclose(report.fit.bias, BIAS, atol=5e-3)
    assert report.fit.scale == pytest.approx(1.0, abs=0.01)
    text = " ".join(report.findings)
    assert "sits otherwise: 17" in text
    assert ("clock that is off" in text) == (late != 0.0)
    if late:
        assert f"timeshift_cam_imu: {report.sensor.time_offset * -1.0:.4f}" in text


def test_one_that_fits_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    report = checked(log_of(sensed()), monkeypatch)
    assert report.agrees
    assert report.findings == report.notes == []
    assert report.told_left is not None
    assert np.rad2deg(report.told_left) < 0.3


ORDER = np.eye(3)[[1, 2, 0]]


@pytest.mark.parametrize(
    ("change", "sensor", "message"),
    [
        (np.rad2deg(1.0) * np.eye(3), Imu(R_CI), "in degrees a second.*0.0174533"),
        (1.3 * np.eye(3), Imu(R_CI), r"times 0\.7\d+, fit the images"),
        (np.eye(3), Imu(R_CI.T), "mount that is inverted"),
        (np.diag([1.0, -1.0, 1.0]), Imu(R_CI), "x, -y, z of the sensor"),
        (-np.eye(3), Imu(R_CI), "-x, -y, -z of the sensor"),
        (np.eye(3)[[2, 1, 0]], Imu(R_CI), "z, y, x of the sensor"),
        (ORDER, Imu(R_CI), "y, z, x of the sensor"),
    ],
)
def test_the_usual_mistakes_are_named(
    monkeypatch: pytest.MonkeyPatch, change: Array, sensor: Imu, message: str
) -> None:
    """A file whose columns x, y, z are ``change`` times the sensor's."""
    rates = sensed() @ change.T
    report = checked(log_of(rates, sensor), monkeypatch)
    (finding,) = report.findings
    assert re.search(message, finding), finding
    assert not report.agrees


def test_a_log_of_something_else_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    report = checked(log_of(sensed()[::-1] * [1.0, 0.2, 1.0]), monkeypatch)
    assert "does not turn as the images do" in report.findings[0]
    assert report.sensor is None


def test_what_the_images_do_not_tell_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    still = checked(log_of(sensed()), monkeypatch, turns(np.array([0.01, 0.01, 0.01])))
    assert "hardly turns" in still.notes[0]
    rates = (swings(TIMES) * [0.0, 1.0, 0.0]) @ R_CI
    one = checked(log_of(rates), monkeypatch, turns(np.array([0.0, 1.0, 0.0])))
    assert "about one axis alone" in one.notes[0]
    assert one.sensor is None
    assert one.findings == []
    few = checked(log_of(sensed()), monkeypatch, Turns(*(part[:5] for part in turns())))
    assert "Only 5 pairs" in few.notes[0]
    other_time = checked(log_of(sensed(), times=TIMES + 500.0), monkeypatch)
    assert "share too little time" in other_time.notes[0]


def test_gaps_of_the_samples_are_not_bridged(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = (TIMES < 5.0) | (TIMES > 6.0)
    log = replace(log_of(sensed()), times=TIMES[kept], rates=sensed()[kept])
    _, _, known = Integrated(log).between(np.array([4.0, 4.9, 5.5, 6.1]), np.array([4.3, 5.2, 5.7, 6.4]))
    assert known.tolist() == [True, False, False, True]
    assert checked(log, monkeypatch).agrees


@pytest.mark.parametrize("along", [(0.0, 0.0, 0.0), (0.1, 0.02, 0.05)])
def test_the_motion_between_two_images(clip: Clip, along: tuple[float, float, float]) -> None:
    """With wrong matches, and with no way at all, which no essential matrix likes."""
    model = MirroredCamera(clip.recording.camera)
    generator = np.random.default_rng(2)
    t_ab = se3_exp(np.array([*along, 0.02, -0.05, 0.03]))
    points = generator.uniform([-2.0, -1.5, 2.0], [2.0, 1.5, 6.0], (120, 3))
    moved = (pose_inverse(t_ab) @ np.c_[points, np.ones(120)].T).T[:, :3]
    a, b = (
        clip.recording.camera.project(p).uv + 0.3 * generator.standard_normal((120, 2))
        for p in (points, moved)
    )
    b[:20] = generator.uniform([0, 0], [700, 470], (20, 2))
    motion = relative_motion(Matches(a, b), model)
    assert motion is not None
    assert np.rad2deg(np.linalg.norm(rotation_log(motion.t_ab[:3, :3] @ t_ab[:3, :3].T))) < 0.2
    assert (motion.parallax > PARALLAX) == any(along)
    if any(along):
        way = np.array(along) / np.linalg.norm(along)
        assert np.rad2deg(np.arccos(motion.t_ab[:3, 3] @ way)) < 3.0  # and not the way back
    assert relative_motion(Matches(a[:10], b[:10]), model) is None


@pytest.mark.slow
def test_images_tell_how_the_camera_turned(clip: Clip) -> None:
    found = image_turns(Turned(clip, None))
    assert len(found.first) > 12
    true = [
        rotation_log(clip.recording.robot(a)[:3, :3].T @ clip.recording.robot(b)[:3, :3])
        for a, b in zip(found.first, found.second, strict=True)
    ]
    assert np.rad2deg(np.median(np.linalg.norm(found.vectors - true, axis=1))) < 0.1


def test_the_commands_say_so(
    clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(gyroscope, "image_turns", lambda _: turns())
    with RecordingWriter(tmp_path / "walk", clip.recording.camera, imu=Imu(R_CI)) as writer:
        for k, frame in enumerate(clip.frames[:3]):
            writer.add(2.0 + 0.1 * k, frame.image)
        for t, rate in zip(TIMES + 0.1, sensed(), strict=True):
            writer.add_gyro(t, rate)
    assert cli.main(["check-calib", str(tmp_path / "walk")]) == 1
    said = capsys.readouterr().out
    assert re.search(r"added to its stamps +-0\.(09|10)", said)
    assert "The gyroscope has a clock that is off: with -0." in said
    assert "The gyroscope turns as the images do" not in said
    # What init writes fits.
    assert cli.main(["init", str(tmp_path / "walk"), "--out", str(tmp_path / "new")]) == 0
    assert "gyroscope" in capsys.readouterr().out
    imu = ["--imu", str(tmp_path / "new" / "imu.yaml")]
    assert cli.main(["check-calib", str(tmp_path / "walk"), *imu]) == 0
    assert "The gyroscope turns as the images do" in capsys.readouterr().out
    assert cli.main(["check-calib", str(tmp_path / "walk"), "--gyro", "none"]) == 1  # nothing else is known
    assert "gyroscope" not in capsys.readouterr().out


class Worn(WrappedRecording):
    """The clip, whose views come a little after their frames."""

    LATE = 0.01

    def __init__(self, clip: Clip, log: ImuLog | None = None) -> None:
        super().__init__(clip.recording)
        self.times, self._frames = self.times[: len(clip.frames)], clip.frames
        self.worn_imu = {} if log is None else {"": log}

    def __len__(self) -> int:
        return len(self._frames)

    def frame(self, i: int) -> Frame:
        frame = self._frames[i]
        return replace(frame, views=tuple(replace(v, t=frame.t + self.LATE) for v in frame.views))


@pytest.mark.slow
def test_views_tell_how_the_worn_camera_turned(clip: Clip) -> None:
    found = worn_turns(Worn(clip), "")
    assert len(found.first) > 12
    person = clip.recording.person
    true = [
        rotation_log(person(a - Worn.LATE)[:3, :3].T @ person(b - Worn.LATE)[:3, :3])
        for a, b in zip(found.first, found.second, strict=True)
    ]
    assert np.rad2deg(np.median(np.linalg.norm(found.vectors - true, axis=1))) < 0.2


@pytest.mark.parametrize(
    ("sensor", "said"),
    [
        (Imu(R_CI), None),
        (Imu(R_CI.T), "Cf's gyroscope has a mount that is inverted"),
        (Imu(rotation_exp([0.0, 0.0, 0.8]) @ R_CI), "Cf's gyroscope sits otherwise.*--worn-imu"),
        (Imu(R_CI, time_offset=0.1), "Cf's gyroscope has a clock that is off.*--worn-imu"),
    ],
)
def test_a_worn_cameras_own_gyroscope_is_checked(
    clip: Clip,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    sensor: Imu,
    said: str | None,
) -> None:
    monkeypatch.setattr(gyroscope, "worn_turns", lambda *_: turns())
    worn = Worn(clip, log_of(sensed(), sensor))
    found = check_worn_gyroscopes(worn)
    assert found[""].agrees == (said is None)
    assert said is None or re.search(said, found[""].findings[0])
    assert check_worn_gyroscopes(Worn(clip)) == {}
    source = SimpleNamespace(open=lambda: worn)
    monkeypatch.setattr("collabslam.cli.options.source_with_worn", lambda _: source)
    for part in ("check_persons", "check_wheels"):
        module = "calibration" if part == "check_persons" else "wheels"
        answer = {"": CalibrationReport()} if part == "check_persons" else None
        monkeypatch.setattr(f"collabslam.checks.{module}.{part}", lambda *_, answer=answer: answer)
    assert cli.main(["check-calib", "walk"]) == (0 if said is None else 1)
    shown = capsys.readouterr().out
    assert ("The gyroscope of Cf turns as its views do" in shown) == (said is None)
    assert re.search(r"pairs without the gyroscope's, Cf +\d", shown)

"""`Slam.add_acceleration`: which way is down, at rest and on the way, while the frames come."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.clip import Clip
from helpers.gyro import R_CI, of_clip
from helpers.level import SETTINGS, UP, off, recorded

from collabslam import Camera, Imu, InputError, Slam
from collabslam.errors import DataError
from collabslam.level import GRAVITY, Level
from collabslam.results import StepResult
from collabslam.runs.level import measured_level
from collabslam.slam import inertial_samples, level_estimator
from collabslam.slam.inertial_samples import InertialSamples
from collabslam.slam.level_estimator import LevelEstimator
from collabslam.types import Array

CAMERA = Camera("pinhole", 640, 480, (420.0, 420.0, 320.0, 240.0), [])
RATE = 200


class Standing:
    """A camera at rest that knows its depths, and the sensor beside it.

    Parameters
    ----------
    clip : Clip
    force : (3,) array, optional
        Specific force along the axes of Cs, m/s^2.
    """

    def __init__(self, clip: Clip, force: Array = GRAVITY * UP) -> None:
        self._random, self._tremble = (np.random.default_rng(seed) for seed in (6, 7))
        self._image, self._force, self._given, self._frames = clip.frames[0].image, R_CI.T @ force, 0, 0
        camera = clip.recording.camera
        depth = clip.recording.renderer.depth(clip.recording.truth[0], camera)
        v, u = np.mgrid[40 : camera.height - 40 : 8, 40 : camera.width - 40 : 8]
        self._depths = np.stack([u.ravel(), v.ravel()], axis=1), depth[v.ravel(), u.ravel()]
        self.slam = Slam(camera, mode="mono", start="depth", imu=Imu(R_CI, accel_bias_sd=0.05, mount_sd=1e-3))

    def go_on(self, seconds: float, *, told: bool = True) -> StepResult:
        """The last of the frames of so many seconds; the sensor speaks if it is ``told``."""
        random, until = self._random, self._frames / 10.0 + seconds
        while self._frames / 10.0 < until:
            t = self._frames / 10.0
            while self._given / RATE <= t:
                stamp, self._given = self._given / RATE, self._given + 1
                self.slam.add_gyro(stamp, 1e-3 * random.standard_normal(3))
                if told:
                    self.slam.add_acceleration(stamp, self._force + 0.05 * self._tremble.standard_normal(3))
            noise = random.normal(0.0, 2.0, self._image.shape)
            if self._frames < 2:
                self.slam.add_depth(*self._depths, 0.01 * self._depths[1])
            result = self.slam.step(t, np.clip(self._image + noise, 0, 255).astype(np.uint8))
            self._frames += 1
        return result


def test_at_rest_it_is_known_in_a_second_or_two(clip: Clip, tmp_path: Path) -> None:
    standing = Standing(clip)
    assert standing.go_on(1.2).level is None
    found = standing.go_on(0.8).level
    assert found is not None
    assert "at rest" in found.source
    assert off(found) < np.deg2rad(1.0)
    assert 0.05 / GRAVITY < np.sqrt(found.covariance[0, 0]) < np.deg2rad(1.5)
    # It goes on from a file to the bit, with what waits.
    standing.slam.add_gyro(99.0, [0.0, 0.0, 0.1])
    standing.slam.add_acceleration(99.0, [0.0, 0.0, 9.0])
    standing.slam.save(tmp_path / "engine")
    again = Slam.load(tmp_path / "engine")
    image = clip.frames[1].image
    first, second = standing.slam.step(100.0, image).level, again.step(100.0, image).level
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first.up, second.up)
    np.testing.assert_array_equal(first.covariance, second.covariance)
    with pytest.raises(InputError, match="does not follow"):
        again.add_acceleration(98.0, [0.0, 0.0, 9.0])


@pytest.mark.parametrize("force", [UP, 0.05 * UP, 0.0 * UP, 9.81 * 9.81 * UP])
def test_what_is_no_gravity_tells_nothing(clip: Clip, force: Array) -> None:
    """In g, without gravity, and in another unit."""
    assert Standing(clip, force).go_on(2.5).level is None


def test_poses_do_not_depend_on_it(clip: Clip) -> None:
    with_it, plain = Standing(clip).go_on(0.5), Standing(clip).go_on(0.5, told=False)
    np.testing.assert_array_equal(plain.pose, with_it.pose)
    np.testing.assert_array_equal(plain.covariance, with_it.covariance)
    assert plain.level is None


def test_on_the_way_it_is_what_a_run_says_afterwards(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(level_estimator, "LEAST_WAY", 0.3)
    log = of_clip(clip)
    true = np.array([clip.recording.robot(float(t))[:3, :3].T @ [0.0, 0.0, GRAVITY] for t in log.times])
    forces = (true @ R_CI) + 0.02 * np.random.default_rng(5).standard_normal(true.shape)
    slam = Slam(clip.recording.camera, clip.recording.worn_camera, imu=log.sensor)
    given, found = 0, None
    for frame in clip.frames:
        while log.times[given] + log.sensor.time_offset <= frame.t + 0.05:
            slam.add_gyro(log.times[given], log.rates[given])
            slam.add_acceleration(log.times[given], forces[given])
            given += 1
        found = slam.step(frame.t, frame.image, frame.views).level or found
    assert found is not None
    assert "in the mean" in found.source
    assert off(found, true[40] / GRAVITY) < 3.0 * np.sqrt(found.covariance[0, 0])


@pytest.mark.parametrize("moving", [0.0, 1.0])
def test_frames_and_samples_as_they_come_give_what_the_whole_gives(moving: float) -> None:
    """But for the last half second, of which nobody knows yet whether it rests."""
    record, log = recorded(moving)
    assert log.accelerations is not None
    forces, rates = InertialSamples(), InertialSamples()
    sizes = SETTINGS.replace(log.sensor.sizes).filter.imu
    estimator = LevelEstimator(sizes, forces, rates, metric=True)
    estimator.sits(log.sensor)
    given, most, found = 0, 0, None
    for k, t in enumerate(record.times.tolist()):
        while given < len(log) and log.times[given] <= t:
            estimator.add_rate(float(log.times[given]), log.rates[given])
            estimator.add_acceleration(float(log.times[given]), log.accelerations[given])
            given += 1
        # A repeated call: the state is that of a file.
        estimator.restore(estimator.state())
        estimator.frame(t, record.poses[k], record.covariances[k], usable=True)
        most, found = max(most, len(forces)), estimator.level()
    whole = measured_level(record, log, SETTINGS, metric=True)  # type: ignore[arg-type]
    assert isinstance(found, Level)
    assert isinstance(whole, Level)
    assert most < 2 * RATE  # of twelve seconds
    assert off(found, whole.up) < np.deg2rad(0.2)
    assert found.covariance[0, 0] == pytest.approx(whole.covariance[0, 0], rel=0.05)
    estimator.finish()
    whole_again = estimator.level()
    assert whole_again is not None
    np.testing.assert_allclose(whole_again.up, whole.up, atol=2e-3)
    assert whole_again.source == whole.source


def test_a_sensor_that_is_stuck_tells_nothing() -> None:
    record, log = recorded(0.0)
    assert log.accelerations is not None
    log.accelerations[:] = log.accelerations[0]
    assert measured_level(record, log, SETTINGS, metric=True) is None  # type: ignore[arg-type]
    record, log = recorded(0.0)
    log.rates[:] = 0.0  # whether it rests is not known then
    found = measured_level(record, log, SETTINGS, metric=True)  # type: ignore[arg-type]
    assert found is not None
    assert "in the mean" in found.source


def test_bad_accelerations_are_refused_and_nothing_is_kept() -> None:
    slam = Slam(CAMERA, start="scale-free", mode="mono", imu=Imu())
    slam.add_acceleration(0.0, [0.0, 0.0, 9.8])
    slam.add_acceleration(0.005, (0.0, 0.1, 9.8))
    before = slam.state()["parts"]["forces"]
    for t, value in [
        (0.004, [0, 0, 9.8]),
        (0.005, [0, 0, 9.8]),
        (0.01, [np.nan, 0, 9.8]),
        (0.01, [0, 9.8]),
        (0.01, None),
        (0.01, "up"),
        (0.01, [[0, 0, 9.8]]),
        (np.nan, [0, 0, 9.8]),
        (4000.0, [0, 0, 9.8]),
        (1e18, [0, 0, 9.8]),
        ("now", [0, 0, 9.8]),
    ]:
        with pytest.raises(InputError):
            slam.add_acceleration(t, value)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="not thousandths of g"):
        slam.add_acceleration(0.01, [0.0, 9806.0, 0.0])
    after = slam.state()["parts"]["forces"]
    assert after["_fresh"] == before["_fresh"] == [(0.0, 0.0, 0.0, 9.8), (0.005, 0.0, 0.1, 9.8)]
    assert after["_last"] == 0.005
    with pytest.raises(InputError, match=r"imu=Imu\(r_ci\)"):
        Slam(CAMERA, start="scale-free", mode="mono").add_acceleration(0.0, [0.0, 0.0, 9.8])


def test_what_waits_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inertial_samples, "MOST", 3)
    slam = Slam(CAMERA, start="scale-free", mode="mono", imu=Imu())
    for k in range(3):
        slam.add_acceleration(0.01 * k, [0.0, 0.0, 9.8])
    with pytest.raises(InputError, match="wait for a frame"):
        slam.add_acceleration(0.03, [0.0, 0.0, 9.8])
    # Frames without a pose let the old ones go, too.
    random = np.random.default_rng(1)
    for k in range(30):
        slam.step(0.1 + k, random.integers(0, 255, (480, 640)).astype(np.uint8))
        slam.add_acceleration(0.15 + k, [0.0, 0.0, 9.8])
    assert len(slam._parts.forces) <= 2


def test_a_file_with_impossible_sums_is_refused() -> None:
    slam = Slam(CAMERA, start="scale-free", mode="mono", imu=Imu())
    for name, value in {
        "_resting": (1.0, 0.0, np.zeros(3), 0.0),
        "_every": (1.0, -1.0, np.zeros(3), 0.0),
        "_change": (np.zeros(3), 1, 0, np.zeros(2), np.zeros(3)),
        "_frames": [(0, 0.0, np.zeros((4, 4)), np.eye(3))],
        "_r_ci": np.full((3, 3), np.nan),
    }.items():
        state = slam.state()
        state["parts"]["level"] = {**state["parts"]["level"], name: value}
        with pytest.raises(DataError):
            Slam.from_state(state)

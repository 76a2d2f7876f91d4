"""A gyroscope beside the images: what `Slam.add_gyro` takes and refuses (METHOD 28)."""

from __future__ import annotations

import numpy as np
import pytest

from collabslam import Camera, Imu, InputError, Settings, SettingsError, Slam, Status
from collabslam.geometry import pose_inverse
from collabslam.settings.table import switches
from collabslam_lab.gyro.simulated import KINDS, simulated_gyro
from collabslam_lab.worlds import world_recording

CAMERA = Camera("pinhole", 640, 480, (420.0, 420.0, 320.0, 240.0), [])


def test_rates_are_kept_in_order_and_others_refused() -> None:
    slam = Slam(CAMERA, start="scale-free", mode="mono", imu=Imu())
    slam.add_gyro(0.0, [0.1, 0.2, 0.3])
    slam.add_gyro(0.005, [0.1, 0.2, 0.3])
    assert slam.filter.gyro_time == 0.005
    for t, rate in [(0.004, [0, 0, 0]), (0.01, [np.nan, 0, 0]), (0.01, [0, 0]), (1e18, [0, 0, 0])]:
        with pytest.raises(InputError):
            slam.add_gyro(t, rate)
    with pytest.raises(InputError, match="give rad/s, not degrees"):
        slam.add_gyro(0.01, [0.0, 90.0, 0.0])
    assert slam.filter.gyro_time == 0.005


def test_an_imu_says_how_it_sits_and_how_good_it_is() -> None:
    slam = Slam(
        CAMERA,
        start="scale-free",
        mode="mono",
        imu=Imu(gyro_bias_sd=0.02, time_offset=0.3, time_offset_sd=0.01),
    )
    bias, covariance = slam.filter.gyro_bias
    np.testing.assert_allclose(bias, 0.0)
    np.testing.assert_allclose(covariance, 4e-4 * np.eye(3), atol=1e-18)
    np.testing.assert_allclose(slam.filter.gyro_clock, (0.3, 0.01))
    assert Settings.default().filter.imu.gyro_bias_sd > 0.02
    with pytest.raises(InputError, match="not a rotation"):
        Slam(CAMERA, start="scale-free", mode="mono", imu=Imu(r_ci=np.diag([1.0, 1.0, -1.0])))
    with pytest.raises(SettingsError):
        Slam(CAMERA, start="scale-free", mode="mono", imu=Imu(mount_sd=-1.0))


def test_without_an_imu_rates_are_refused() -> None:
    slam = Slam(CAMERA, start="scale-free", mode="mono")
    with pytest.raises(InputError, match="made without one"):
        slam.add_gyro(0.0, [0.1, 0.2, 0.3])
    assert slam.filter.gyro_bias is None


def test_the_lab_may_leave_it_aside() -> None:
    settings = Settings.default().changed({"frontend.gyro.follow": False}, switches())
    slam = Slam(CAMERA, start="scale-free", mode="mono", settings=settings, imu=Imu())
    slam.add_gyro(0.0, [0.1, 0.2, 0.3])
    assert slam.filter.follows_gyro is False
    assert Slam(CAMERA, start="scale-free", mode="mono", imu=Imu()).filter.follows_gyro is True


@pytest.mark.slow
def test_a_sensor_that_turns_the_other_way_is_named_and_left_aside() -> None:
    world = world_recording("turn180-2-life")
    log = simulated_gyro(world.robot, world.times, KINDS["phone"], np.random.default_rng(1)).log
    slam = Slam(world.camera, world.worn_camera, mode="collab-tight", imu=log.sensor)
    origin, given, causes, wrong = pose_inverse(world.truth[0]), 0, [], 0
    for i in range(35):
        frame = world.frame(i)
        while log.times[given] <= frame.t + 0.03:
            slam.add_gyro(log.times[given], -log.rates[given])
            given += 1
        result = slam.step(frame.t, frame.image, frame.views)
        causes.append(result.diagnostics["degraded_by"])
        off = (pose_inverse(result.pose) @ origin @ world.truth[i])[:3, 3]
        excess = off @ np.linalg.pinv(result.covariance[:3, :3]) @ off
        wrong += result.status is Status.OK and i > 0 and excess > 25.0
    assert result.gyro is not None
    assert not result.gyro.followed
    assert causes.count("gyro") >= 10
    assert wrong <= 2

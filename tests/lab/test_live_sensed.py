"""T_CF from laser scans and AHRSs while they come: what the same readings give offline."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from collabslam import DataError
from collabslam.live import messages
from collabslam.live.sensed import WAITING, SensedPoses, reading_from, scan_from
from collabslam.worn_pose import LaserScan, WornPoseConfig, WornPoseEstimator, estimates_at
from collabslam_lab.worlds.recording import world_recording
from collabslam_lab.worlds.sensors import config_of, readings_of

END = 4.0
"""Seconds of the walk."""


def test_readings_that_come_in_any_order_give_what_they_give_offline() -> None:
    world = world_recording("turn90-0")
    readings = readings_of(world, 0)
    times = world.times[world.times < END - 0.5].tolist()
    scans = [s for s in readings.scans if s.t < END]
    attitudes = [a for a in readings.attitudes if a.t < END]
    offline = estimates_at(times, WornPoseEstimator(config_of(world)), scans, attitudes)
    late = np.random.default_rng(0)
    arrivals: list[tuple[float, int, Any]] = [(a.t, 0, a) for a in attitudes]
    arrivals += [(s.t + late.uniform(0.0, 0.08), 1, s) for s in scans]
    arrivals += [(t + late.uniform(0.0, 0.08), 2, t) for t in times]
    sensed, found = SensedPoses(config_of(world)), []
    for _, kind, item in sorted(arrivals, key=lambda a: a[:2]):
        if kind == 2:
            sensed.add(item, "cf")
        elif kind == 1:
            sensed.scan(item)
        else:
            sensed.reading(item)
        found += sensed.known("cs")
    known = [e for e in offline if e.t_cf is not None]
    assert len(known) > 0.8 * len(times)
    assert sum(sensed.reasons.values()) == len(times) - len(known)
    assert [t for t, *_ in found] == [e.t for e in known]
    for (_, t_cf, covariance, bias), estimate in zip(found, known, strict=True):
        np.testing.assert_array_equal(t_cf, estimate.t_cf)
        np.testing.assert_array_equal(covariance, estimate.covariance)
        np.testing.assert_array_equal(bias, estimate.bias)


def test_what_waits_is_bounded() -> None:
    sensed = SensedPoses(WornPoseConfig())
    for k in range(10 * WAITING):
        sensed.add(float(k), "cf")
    assert len(sensed._waiting) == WAITING


def test_messages_of_the_sensors() -> None:
    ranges = np.linspace(1.0, 2.0, 5, dtype=np.float32)
    header = messages.header(7.25, "laser")
    message = messages.make(messages.SCAN, header, -0.5, 0.5, 0.25, 0.0, 0.1, 0.3, 20.0, ranges, ranges)
    scan = scan_from(messages.decoded(messages.SCAN, messages.encoded(messages.SCAN, message)), "front")
    assert isinstance(scan, LaserScan)
    assert (scan.t, scan.scanner, scan.angle_min, scan.angle_increment) == (7.25, "front", -0.5, 0.25)
    np.testing.assert_array_equal(scan.ranges, ranges)
    turned = imu((0.0, 0.6, 0.0, 0.8))
    reading = reading_from(turned, "worn")
    assert (reading.t, reading.where) == (7.25, "worn")
    np.testing.assert_allclose(reading.q_xyzw, (0.0, 0.6, 0.0, 0.8))
    with pytest.raises(DataError, match="worn"):
        reading_from(imu((0.0, 0.0, 0.0, 0.0)), "worn")


def imu(q_xyzw: tuple[float, float, float, float]) -> Any:
    """An Imu message with nothing but an attitude."""
    none, zero = np.zeros(9), messages.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
    attitude = messages.make("geometry_msgs/msg/Quaternion", *q_xyzw)
    message = messages.make(
        messages.IMU, messages.header(7.25, "imu"), attitude, none, zero, none, zero, none
    )
    return messages.decoded(messages.IMU, messages.encoded(messages.IMU, message))

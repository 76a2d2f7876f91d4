"""T_CF from laser scans and AHRSs while they come: what the same readings give offline."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from collabslam import DataError
from collabslam.live import messages, names, uplink
from collabslam.live.clock import Exchange
from collabslam.live.senders import SILENT
from collabslam.live.sensed import WAITING, SensedPoses, reading_from, scan_from
from collabslam.live.sensing import Sensing
from collabslam.live.uplink import Uplink
from collabslam.live.views import LiveView
from collabslam.worn_pose import AhrsReading, LaserScan, WornPoseConfig, WornPoseEstimator, estimates_at
from collabslam_lab.worlds.recording import world_recording
from collabslam_lab.worlds.sensors import config_of, readings_of

pytestmark = pytest.mark.slow

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
            sensed.add(item, item)
        elif kind == 1:
            sensed.scan(item)
        else:
            sensed.reading(item)
        found += sensed.known()
    known = [e for e in offline if e.t_cf is not None]
    assert len(known) > 0.8 * len(times)
    assert sum(sensed.reasons.values()) == len(times) - len(known)
    assert [t for t, *_ in found] == [e.t for e in known]
    for (_, t_cf, covariance, bias), estimate in zip(found, known, strict=True):
        np.testing.assert_array_equal(t_cf, estimate.t_cf)
        np.testing.assert_array_equal(covariance, estimate.covariance)
        np.testing.assert_array_equal(bias, estimate.bias)


@pytest.mark.parametrize("all_of_them", [False, True])
def test_sensors_over_the_link_give_what_they_give_offline(
    monkeypatch: pytest.MonkeyPatch, *, all_of_them: bool
) -> None:
    """The worn one's attitudes come over the link, by its own clock; the robot's readings, too, or not."""
    monkeypatch.setattr(uplink, "RATES", dict.fromkeys(uplink.RATES, 1e9))
    off = 100.0  # the device's clock is so much ahead
    world = world_recording("turn90-0")
    readings = readings_of(world, 0)
    times = world.times[world.times < END - 0.5].tolist()
    scans = [s for s in readings.scans if s.t < END]
    attitudes = [a for a in readings.attitudes if a.t < END]
    offline = estimates_at(times, WornPoseEstimator(config_of(world)), scans, attitudes)
    events: list[Any] = []
    up = Uplink(events.append, lambda: 0.0, sensors=config_of(world))
    assert up.sensing is not None
    for name in ("anna", "base"):
        up.take(names.key(name, names.EXCHANGE), messages.exchange(f"{name}/1", Exchange(off, 0.0, 0.0, off)))
    for item in sorted([*scans, *attitudes, *times], key=lambda i: i if isinstance(i, float) else i.t):
        if isinstance(item, float):
            message = messages.compressed_image(item + off, "anna/1", b"\xff\xd8 and so on")
            up.take(names.key("anna", names.IMAGE), message)
        elif isinstance(item, AhrsReading) and item.where == "worn":
            message = messages.attitude(item.t + off, "anna/1", item.q_xyzw)
            up.take(names.key("anna", names.ATTITUDE), message)
        elif isinstance(item, AhrsReading):
            message = messages.attitude(item.t + off, "base/1", item.q_xyzw)
            over = partial(up.take, names.key("base", names.ROBOT_ATTITUDE), message)
            over() if all_of_them else up.sensing.reading(item)
        else:
            message = messages.scan(item.t + off, f"base/1/{item.scanner}", item)
            over = partial(up.take, names.key("base", names.SCAN), message)
            over() if all_of_them else up.sensing.scan(item)
    views = [e for e in events if isinstance(e, LiveView)]
    known = [e for e in offline if e.t_cf is not None]
    assert up.counts().keys() <= {uplink.UNPAIRED}
    assert sum(up.unposed().values()) == len(times) - len(known)
    np.testing.assert_allclose([v.stamp - off for v in views], [e.t for e in known], atol=1e-6)
    for view, estimate in zip(views, known, strict=True):
        assert estimate.t_cf is not None
        np.testing.assert_allclose(view.t_cf, estimate.t_cf, atol=1e-3)
        np.testing.assert_allclose(view.covariance, estimate.covariance, rtol=0.05, atol=1e-6)
        assert view.bias is not None
        assert estimate.bias is not None
        np.testing.assert_allclose(view.bias, estimate.bias, rtol=0.05, atol=1e-6)


LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def test_the_attitudes_are_of_one_device_until_it_is_silent() -> None:
    sensing = Sensing(WornPoseConfig(), lambda *_: None)
    first = sensing._sensed
    sensing.worn("anna", AhrsReading(5.0, LEVEL, "worn"))
    sensing.worn("berta", AhrsReading(5.0 + SILENT, LEVEL, "worn"))
    assert sum(sensing.reasons.values()) == 1
    assert sensing._sensed is first
    sensing.worn("berta", AhrsReading(5.1 + SILENT, LEVEL, "worn"))
    assert sum(sensing.reasons.values()) == 1
    assert sensing._sensed is not first  # somebody else's legs


def test_readings_that_are_of_no_use_are_counted() -> None:
    attitude, key = messages.attitude(7.0, "anna/1", LEVEL), names.key("anna", names.ATTITUDE)
    unasked = Uplink(lambda _: None, lambda: 7.0)
    unasked.take(key, attitude)
    assert unasked.counts() == {uplink.UNASKED: 1}
    up = Uplink(lambda _: None, lambda: 7.0, sensors=WornPoseConfig())
    up.take(key, attitude)  # nothing is known of its clock
    up.take(names.key("anna", names.EXCHANGE), messages.exchange("anna/2", Exchange(1.0, 1.0, 1.0, 1.0)))
    up.take(key, attitude)  # of a session that is over
    assert up.counts() == {"no clock": 2}
    many = LaserScan(7.0, np.ones(uplink.MOST_BEAMS + 1), 0.0, 1e-3)
    up.take(names.key("anna", names.SCAN), messages.scan(7.0, "anna/2/front", many))
    assert up.counts() == {"no clock": 2, "malformed": 1}
    assert "beams" in up.said()["last refusal"]


def test_what_waits_is_bounded() -> None:
    sensed = SensedPoses(WornPoseConfig())
    for k in range(10 * WAITING):
        sensed.add(float(k), k)
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

"""A gyroscope while it happens: samples beside frames, in a record, from a recording and from ROS topics."""

from __future__ import annotations

import socket
import sys
from argparse import ArgumentParser
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip
from helpers.gyro import R_CI, Turned, of_clip

pytest.importorskip("rosbags", reason="the extra ros is not installed")
pytest.importorskip("zenoh", reason="the extra live is not installed")

from helpers.driven import tf
from helpers.in_step import InStep
from helpers.rosless import Node, stand_in

from collabslam import DataError, InputError, Settings, SettingsError, Slam
from collabslam.cli.live_ros import configure
from collabslam.datasets.imu.beside import GyroGiven
from collabslam.datasets.imu.description import MOUNTS
from collabslam.geometry import pose
from collabslam.live import link, messages, ros, ros_camera
from collabslam.live.cameras import RecordingPlayback, open_camera
from collabslam.live.core import GyroSample, LivePose
from collabslam.live.gyro_topic import GyroTopic, sample_of
from collabslam.live.link import Address
from collabslam.live.plan import LivePlan, imu_state
from collabslam.live.record import EventReader, EventWriter
from collabslam.live.replay import replay
from collabslam.live.robot import RobotNode, RobotOptions
from collabslam.live.ros import RosNode, RosTopics
from collabslam.live.slam import LiveSlam
from collabslam.types import Imu

SENSOR = Imu(R_CI, gyro_bias_sd=0.04, time_offset=0.0)


@pytest.fixture
def without_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch)


def test_rates_are_pushed_recorded_and_replayed(clip: Clip, tmp_path: Path) -> None:
    log, source = of_clip(clip, sensor=SENSOR), clip.recording
    settings = dict(Settings.default().values)
    plan = LivePlan("mono", "scale-free", settings, [], [], imu=imu_state(SENSOR))
    assert LivePlan.of(plan.written, "here") == plan
    assert plan.sensor is not None
    np.testing.assert_array_equal(plan.sensor.r_ci, R_CI)
    assert (plan.sensor.gyro_bias_sd, plan.sensor.mount_sd) == (0.04, None)
    poses: list[LivePose] = []
    with EventWriter(tmp_path / "record", plan, source.camera, {}) as record:
        slam = Slam(source.camera, mode="mono", start="scale-free", imu=SENSOR)
        with LiveSlam(slam, on_pose=poses.append, on_event=lambda e: record.write(e, 0.0)) as live:
            sent = 40  # stamps of a message are not negative
            for frame in clip.frames[:6]:
                while log.times[sent] <= frame.t + 0.01:
                    live.push_gyro(round(float(log.times[sent]), 9), log.rates[sent], [0.0, sent, 9.8])
                    sent += 1
                live.push_robot(frame.t, frame.image)
            live.push_gyro(0.01, log.rates[0])  # late
            live.push_gyro(99.0, [0.0, 0.0, 90.0])  # in degrees
            live.push_gyro(99.0, [0.0, 0.0, 0.1], [0.0, 0.0, 9806.0])  # in thousandths of g
            with pytest.raises(InputError, match="rate has the shape"):
                live.push_gyro(9.0, [1.0])
            with pytest.raises(InputError, match="acceleration has the shape"):
                live.push_gyro(99.1, [0.0, 0.0, 0.1], [1.0])
            with pytest.raises(InputError, match="give one"):
                live.push_gyro(9.0, None)  # type: ignore[arg-type]
    assert len(live.refused) == 3
    assert slam.filter.gyro_time == 99.0
    assert replay(tmp_path / "record", tmp_path / "again")["frames"] == len(poses) >= 4
    events = list(EventReader(tmp_path / "record").events())
    rates = [e for e in events if isinstance(e, GyroSample)]
    np.testing.assert_array_equal([e.rate for e in rates[:-3]], log.rates[40:sent])
    np.testing.assert_array_equal(
        [e.acceleration for e in rates[:-3]], [[0, k, 9.8] for k in range(40, sent)]
    )
    assert rates[-2].acceleration is None
    again = np.loadtxt(tmp_path / "again" / "frames.csv", delimiter=",", skiprows=1, usecols=1)
    np.testing.assert_allclose(again, [p.step.t for p in poses])


@pytest.mark.parametrize(
    "imu", [{"r_ci": [1.0] * 8}, {"mount_sd": 0.1}, {"r_ci": "x"}, {"r_ci": [0] * 9, "x": 1}]
)
def test_a_plan_with_an_impossible_sensor_is_refused(imu: dict[str, Any]) -> None:
    plan = LivePlan("mono", "scale-free", dict(Settings.default().values), [], [], imu=imu)
    with pytest.raises(DataError, match="cannot be read"):
        LivePlan.of(plan.written, "here")


def test_a_robot_plays_a_recordings_gyroscope(clip: Clip, tmp_path: Path) -> None:
    log = of_clip(clip)
    forces = np.tile([0.1, 0.2, 9.8], (len(log), 1))
    forces[::2] = np.nan
    recording = Turned(clip, replace(log, accelerations=forces))
    recording.worn_camera = None
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        address = Address("127.0.0.1", s.getsockname()[1])
    asked = RobotOptions(
        tmp_path / "out", Settings.default(), mode="mono", start="scale-free", record=tmp_path / "record"
    )
    with link.open_robot(address, None) as session:
        played = InStep(recording)
        node = RobotNode(session, played, asked)
        played.follow(node)
        assert node.run()["frames"] == len(recording)
    plan = EventReader(tmp_path / "record").plan
    assert plan.sensor is not None
    np.testing.assert_array_equal(plan.sensor.r_ci, R_CI)
    rates = [e for e in EventReader(tmp_path / "record").events() if isinstance(e, GyroSample)]
    assert {None if e.acceleration is None else tuple(e.acceleration) for e in rates} == {
        None,
        (0.1, 0.2, 9.8),
    }
    assert len(rates) >= np.sum((recording.imu.times >= 0) & (recording.imu.times <= recording.times[-1]))


def test_what_is_given_beside_a_camera(clip: Clip, tmp_path: Path) -> None:
    assert RecordingPlayback(Turned(clip, None)).imu is None
    with pytest.raises(SettingsError, match="has no gyroscope that --gyro and --imu could tell of"):
        open_camera("/dev/video7", None, gyro=GyroGiven("/imu"))
    with pytest.raises(SettingsError, match="give that"):
        open_camera("ros:/cs", None, gyro=GyroGiven(None, "ros"))


class Executor:
    """Gives a node's subscriptions what was sent, a message at a time."""

    def __init__(self, sent: list[tuple[str, bytes]], node: Node) -> None:
        self.sent, self.node = sent, node

    def spin_once(self, timeout_sec: float) -> None:
        if self.sent:
            topic, data = self.sent.pop(0)
            self.node.takes[topic](data)

    def add_node(self, node: object) -> None: ...
    def shutdown(self) -> None: ...


@pytest.mark.usefixtures("without_ros")
@pytest.mark.parametrize("told", [None, "ros"])
def test_a_topic_of_images_has_a_gyroscope_beside_it(
    clip: Clip, monkeypatch: pytest.MonkeyPatch, told: str | None
) -> None:
    node, now, image = Node(), 1e9, clip.frames[0].image
    monkeypatch.setattr(ros_camera.SystemClock, "now", lambda self: now)
    link = tf(("cs", "imu_link", 0.0, pose(R_CI, [0.1, 0.0, 0.0])))
    sent = [
        ("/cs/camera_info", messages.camera_info(0.0, "cs", clip.recording.camera)),
        ("/imu", rate(now)),
        ("/cs/image_raw", messages.raw_image(now, "cs", image)),
        *([("/tf_static", messages.encoded(messages.TRANSFORMS, link))] if told is None else []),
    ]
    node.destroy_node = lambda: None  # type: ignore[attr-defined]
    context = SimpleNamespace(init=lambda: None, try_shutdown=lambda: None)
    rclpy = SimpleNamespace(Context=lambda: context, create_node=lambda name, context: node)
    monkeypatch.setattr(ros_camera, "rclpy_of", lambda: rclpy)
    executors = ModuleType("rclpy.executors")
    vars(executors).update(SingleThreadedExecutor=lambda context: Executor(sent, node))
    monkeypatch.setitem(sys.modules, "rclpy.executors", executors)
    camera = open_camera("ros:/cs/image_raw", None, gyro=GyroGiven("/imu", told))
    assert camera.imu is not None
    np.testing.assert_allclose(camera.imu.r_ci, R_CI if told is None else MOUNTS["ros"], atol=1e-12)
    taken: list[GyroSample] = []
    camera.turn(taken.append)
    sent += [
        ("/imu", rate(now + 0.01)),
        ("/imu", messages.rate(now + 0.02, np.zeros(3), np.array([0.0, 9.8, 0.0]))),
        ("/imu", b"no message"),
        ("/cs/image_raw", messages.raw_image(now + 0.03, "cs", image)),
    ]
    images = camera.images(lambda: not sent)
    assert next(images).t == pytest.approx(now, abs=1e-6)  # what waited
    assert next(images).t == pytest.approx(now + 0.03, abs=1e-6)
    assert [s.acceleration is None for s in taken[-2:]] == [True, False]
    assert len(taken) == (2 if told is None else 3)  # none is lost once it is known how it sits
    sent[:] = [("/cs/camera_info", messages.camera_info(0.0, "cs", clip.recording.camera))]
    assert open_camera("ros:/cs/image_raw", None, gyro=GyroGiven("none")).imu is None


def rate(t: float, frame: str = "imu_link") -> bytes:
    data = messages.decoded(messages.IMU, messages.rate(t, np.array([0.1, 0.2, 0.3])))
    data.header.frame_id = frame
    return messages.encoded(messages.IMU, data)


@pytest.mark.usefixtures("without_ros")
@pytest.mark.parametrize("told", [None, "ros"])
def test_a_node_hears_a_topic(clip: Clip, told: str | None) -> None:
    node = Node()
    topics = RosTopics("/cs", "/cs_info", gyro=GyroTopic.of("/imu", told))
    running = RosNode(node, topics, Settings.default(), mode="mono", start="scale-free")
    node.takes["/cs_info"](messages.camera_info(0.0, "cs", clip.recording.camera))
    assert (ros.TF_STATIC in node.takes) == (told is None)
    assert (running._live is None) == (told is None)
    node.takes["/imu"](rate(1.0))
    if told is None:
        assert running._live is None  # nobody has said how it sits
        link = tf(("cs", "imu_link", 0.0, pose(R_CI, [0.1, 0.0, 0.0])))
        node.takes[ros.TF_STATIC](messages.encoded(messages.TRANSFORMS, link))
    live = running._live
    assert live is not None
    for t in (1.1, 1.2):
        node.takes["/imu"](rate(t))
    none = messages.decoded(messages.IMU, rate(1.3))
    none.angular_velocity_covariance = np.array([-1.0, *np.zeros(8)])
    node.takes["/imu"](messages.encoded(messages.IMU, none))
    running.close()
    assert live.slam.filter.gyro_time == 1.2
    assert running._refused == 1
    assert live.refused == {}


def test_a_topic_is_described_by_name_or_file() -> None:
    frame, sample = sample_of(rate(1.5))
    assert (frame, sample.t, sample.acceleration) == ("imu_link", 1.5, None)
    np.testing.assert_array_equal(sample.rate, [0.1, 0.2, 0.3])
    _, both = sample_of(messages.rate(1.5, np.zeros(3), np.array([0.0, 9.8, 0.0])))
    np.testing.assert_array_equal(both.acceleration, [0.0, 9.8, 0.0])
    parser, words = ArgumentParser(), ["--cs", "/cs", "--cs-info", "/info"]
    configure(parser)
    asked = parser.parse_args([*words, "--gyro", "/imu", "--imu", "ros"])
    topic = GyroTopic.asked(asked.gyro, asked.imu)
    assert topic is not None
    assert not topic.asks_tf
    assert GyroTopic.asked(None, None) is None
    with pytest.raises(SettingsError, match="--gyro TOPIC; give that"):
        GyroTopic.asked(None, "ros")

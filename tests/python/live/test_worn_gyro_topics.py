"""A worn camera's own gyroscope as a topic of ROS 2: beside Cf at the node, and beside a device's images."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from helpers.clip import Clip

pytest.importorskip("rosbags", reason="the extra ros is not installed")
pytest.importorskip("zenoh", reason="the extra live is not installed")

from helpers.driven import tf
from helpers.gyro import R_CI, samples
from helpers.rosless import Node, stand_in
from helpers.waiting import until

from collabslam import DataError, Settings, SettingsError
from collabslam.cli import live_ros
from collabslam.cli import main as cli
from collabslam.datasets.imu.description import MOUNTS
from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.geometry import pose
from collabslam.live import messages, ros, ros_out
from collabslam.live.core import GyroSample
from collabslam.live.frame_source import CapturedImage
from collabslam.live.gyro_topic import GyroTopic
from collabslam.live.ros import RosNode, RosTopics
from collabslam.live.ros_worn import RosWorn, WornTopics
from collabslam.live.sending import send_all
from collabslam.live.views import LiveView
from collabslam.types import Array, Imu

GREY = np.zeros((48, 64), np.uint8)


def topics_of(imu: str | None = None, name: str = "", gyro: str = "/imu") -> WornTopics:
    return WornTopics(f"{name}/cf", f"{name}/cf_info", f"{name}/t_cf", gyro=GyroTopic.of(gyro, imu))


def at(t: float, value: Array, frame: str = "glasses_imu") -> bytes:
    return messages.rate(t, value, frame=frame)


def heard(worn: RosWorn) -> dict[str, Callable[[bytes], None]]:
    return {topic: take for topic, _, take in worn.takes}


def link() -> bytes:
    return messages.encoded(messages.TRANSFORMS, tf(("glasses", "glasses_imu", 0.0, pose(R_CI, [0.1, 0, 0]))))


@pytest.mark.parametrize("mount", ["tf", "opengl", "file"])
def test_a_view_has_the_rate_of_its_time_along_the_axes_of_cf(tmp_path: Path, mount: str) -> None:
    late = 0.03 if mount == "file" else 0.0
    if mount == "file":
        (tmp_path / "imu.yaml").write_text(f"axes: opengl\ntimeshift_cam_imu: {late}\n")
    told = {"tf": None, "opengl": "opengl", "file": str(tmp_path / "imu.yaml")}[mount]
    tree, views = TransformTree(), list[LiveView]()
    worn = RosWorn("", topics_of(told), tree, views.append)
    takes, (times, rates) = heard(worn), samples(7.0)
    assert worn.gyroscope == "waits for samples on /imu"
    takes["/cf"](messages.raw_image(6.9, "glasses", GREY))
    takes["/t_cf"](messages.pose(6.9, "cs", np.eye(4), np.eye(6)))
    if mount == "tf":
        takes["/imu"](at(6.99, rates[0]))
        assert worn.gyroscope is not None
        assert "'glasses_imu'" in worn.gyroscope
        tree.take(messages.decoded(messages.TRANSFORMS, link()), static=True)
    for t, rate in zip(times[:11], rates[:11], strict=True):
        takes["/imu"](at(float(t) + late, rate))
    taken = 0.3 * times[4] + 0.7 * times[5]
    takes["/t_cf"](messages.pose(float(taken), "cs", np.eye(4), np.eye(6)))
    takes["/cf"](messages.raw_image(float(taken), "glasses", GREY))
    before, view = views
    assert before.rate is None
    turn = R_CI if mount == "tf" else MOUNTS["opengl"]
    np.testing.assert_allclose(view.rate, turn @ (0.3 * rates[4] + 0.7 * rates[5]), atol=1e-6)
    assert worn.gyroscope == "views whose turn it told: 1"


def test_bad_samples_cost_themselves_alone() -> None:
    worn = RosWorn("", topics_of("optical"), TransformTree(), lambda view: None)
    take = heard(worn)["/imu"]
    take(at(1.0, np.array([0.1, 0.2, 0.3])))
    for payload in (
        b"no message",
        at(1.0, np.zeros(3)),  # not later
        at(1.1, np.array([0.0, np.nan, 0.0])),
        at(1.1, np.array([0.0, 0.0, 90.0])),  # in degrees
        messages.attitude(1.1, "glasses_imu", np.array([0.0, 0.0, 0.0, 1.0])),  # without rates
    ):
        with pytest.raises(DataError):
            take(payload)
    np.testing.assert_array_equal(worn._pairing.rates.at("ros/1", 1.0), [0.1, 0.2, 0.3])


@pytest.fixture
def without_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch)


def node_of(worn: dict[str, WornTopics]) -> tuple[Any, RosNode]:
    node: Any = Node()
    return node, RosNode(node, RosTopics("/cs", "/cs_info", worn), Settings.default())


@pytest.mark.usefixtures("without_ros")
def test_the_node_hears_tf_only_where_nothing_else_tells_how_it_sits() -> None:
    for told in (None, "optical"):
        node, running = node_of({"": topics_of(told)})
        assert (ros.TF_STATIC in node.takes) == (told is None)
        running.close()
    with pytest.raises(SettingsError, match="/imu was given for anna and for ben"):
        node_of({"anna": topics_of(name="/anna"), "ben": topics_of(name="/ben")})


@pytest.mark.slow
@pytest.mark.usefixtures("without_ros")
def test_the_filter_uses_it(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each view after the first, whose image tells the frame that tf links, tells how Cf turned."""
    monkeypatch.setattr(ros_out, "STATUS_EVERY", 0.0)
    node, running = node_of({"": topics_of()})
    node.takes["/cs_info"](messages.camera_info(0.0, "cs", clip.recording.camera))
    node.takes["/cf_info"](messages.camera_info(0.0, "cf", clip.recording.worn_camera))
    live = running._live
    assert live is not None  # it does not wait for the link
    node.takes[ros.TF_STATIC](link())
    publish, done = live._on_pose, list[Any]()
    live._on_pose = lambda found: (publish(found), done.append(found.step.diagnostics))
    for k, frame in enumerate(clip.frames[:8]):
        t, worn = frame.t + 1.0, frame.views[0]
        turned = clip.recording.robot
        half = 0.01
        between = turned(frame.t - half)[:3, :3].T @ turned(frame.t + half)[:3, :3]
        rate = np.array([between[2, 1], between[0, 2], between[1, 0]]) / (2.0 * half)
        for late in (-0.005, 0.005):
            node.takes["/imu"](at(t + late, R_CI.T @ worn.t_cf[:3, :3].T @ rate))
        node.takes["/t_cf"](messages.pose(t, "cs", worn.t_cf, worn.covariance))
        node.takes["/cf"](messages.raw_image(t, "glasses", worn.image))
        node.takes["/cs"](messages.raw_image(t, "cs", frame.image))
        assert until(lambda k=k: len(done) == k + 1)
    running.close()
    assert sum(found.get("cf_rate_used", 0) for found in done) >= 4
    first, *_, last = (messages.status_from(data)["robot"] for data in node.sent["/diagnostics"])
    assert "waits for a link of tf" in first["gyroscope of Cf"]
    assert last["gyroscope of Cf"] == "views whose turn it told: 7"


def asked(*words: str) -> dict[str, WornTopics]:
    parser = argparse.ArgumentParser(exit_on_error=False)
    live_ros.configure(parser)
    return live_ros.worn_topics(parser.parse_args(["--cs", "/cs", "--cs-info", "/info", *words]))


def test_options_name_the_topic_of_each() -> None:
    one = ["--cf", "/cf", "--cf-info", "/cf_info", "--t-cf", "/t_cf"]
    assert asked(*one)[""].gyro is None
    found = asked(*one, "--worn-gyro", "/imu", "--worn-imu", "phone-left")[""].gyro
    assert found is not None
    assert (found.name, found.asks_tf) == ("/imu", False)
    np.testing.assert_array_equal(found.told.r_ci, MOUNTS["phone-left"])
    two = [f"{word}{name}{topic}" for name in ("anna=", "ben=") for word, topic in (
        ("--cf=", "/cf"), ("--cf-info=", "/info"), ("--t-cf=", "/t"))]  # fmt: skip
    both = asked(*two, "--worn-gyro", "ben=/imu")
    assert both["anna"].gyro is None
    assert both["ben"].gyro == GyroTopic.of("/imu", None)
    with pytest.raises(SettingsError, match="--worn-gyro TOPIC; give that"):
        asked(*one, "--worn-imu", "optical")
    with pytest.raises(SettingsError, match="of clara needs"):
        asked(*two, "--worn-gyro", "clara=/imu")


class Glasses:
    """Images of a device with a gyroscope beside them, samples before images."""

    def __init__(self, imu: Imu | None, samples: list[GyroSample], times: list[float]) -> None:
        self.imu, self._samples, self._times = imu, samples, times
        self._take: Callable[[GyroSample], None] = lambda sample: None

    def turn(self, take: Callable[[GyroSample], None]) -> None:
        self._take = take

    def images(self, ended: Callable[[], bool]) -> Iterator[CapturedImage]:
        for t in self._times:
            while self._samples and self._samples[0].t <= t:
                self._take(self._samples.pop(0))
            yield CapturedImage(t, GREY)


def sent_by(camera: Glasses) -> list[Array | None]:
    sent: list[Array | None] = []
    device = SimpleNamespace(
        pace=SimpleNamespace(level=SimpleNamespace(rate=10.0)),
        send=lambda t, image, pose=None, rate=None: sent.append(rate),
    )
    send_all(cast(Any, device), cast(Any, camera), lambda: False)
    return sent


def test_a_device_sends_with_an_image_how_it_turned() -> None:
    times, rates = samples(5.0)
    given = [GyroSample(float(t), rate, None) for t, rate in zip(times, rates, strict=True)]
    first, second = sent_by(Glasses(Imu(R_CI, time_offset=0.002), given, [5.1, 5.9]))
    expected = [np.interp(5.098, times, axis) for axis in (rates @ R_CI.T).T]
    np.testing.assert_allclose(first, expected, atol=0.02)  # the next sample may be on its way
    assert second is None  # the sensor has ended
    assert sent_by(Glasses(None, [], [5.1])) == [None]


@pytest.mark.parametrize("source", ["walk", "/dev/video0"])
def test_only_a_topic_of_images_has_one_beside_it(source: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["live", "worn", source, "--insecure", "--gyro", "/imu"]) == 2
    assert "beside the images of ros:TOPIC" in capsys.readouterr().err

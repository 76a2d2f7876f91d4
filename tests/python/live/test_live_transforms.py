"""T_CF from tf: a tree of frames that changes, and images that wait until it tells their pose."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from helpers.driven import COVARIANCE, T_BC, tf, wheels
from helpers.rosless import Node, stand_in
from helpers.waiting import until

from collabslam import DataError, Settings, SettingsError
from collabslam.datasets.odometry import OdometryGiven
from collabslam.datasets.ros.sensors import ESTIMATED, WornSensors, write_sensors
from collabslam.datasets.ros.transform_tree import FRAMES, GAP, KEPT, TransformTree
from collabslam.geometry import pose, pose_inverse, rotation_exp
from collabslam.live import messages, ros
from collabslam.live.ros import RosNode, RosTopics
from collabslam.live.ros_worn import TF, WornTopics
from collabslam.live.transforms import WaitingStamps
from collabslam.live.wheels import WheelSamples, WheelTopic
from collabslam.types import Array
from collabslam.worn_pose import WornPoseConfig

A = pose(rotation_exp([0.1, 0.2, 0.3]), [1.0, 2.0, 3.0])
B = pose(rotation_exp([-0.2, 0.1, 0.0]), [0.5, 0.0, -1.0])
C = pose(rotation_exp([0.0, 0.0, 0.4]), [0.0, 0.7, 0.2])


def tree_of(*links: tuple[str, str, float, Array]) -> TransformTree:
    tree = TransformTree()
    tree.take(tf(("odom", "robot", 1.0, A), ("robot", "cs", 1.0, B)), static=True)
    tree.take(tf(*links), static=False)
    return tree


def test_a_way_through_the_tree_in_both_directions() -> None:
    tree = tree_of(("/odom", "person", 5.0, C), ("person", "cf", 5.0, B))
    found = tree.between("cs", "cf", 5.0)
    assert found is not None
    np.testing.assert_allclose(found, pose_inverse(A @ B) @ C @ B, atol=1e-9)
    back = tree.between("/cf", "cs", 5.0)
    assert back is not None
    np.testing.assert_allclose(found @ back, np.eye(4), atol=1e-9)


def test_between_two_samples_it_goes_evenly() -> None:
    start, end = C, C @ pose(rotation_exp([0.0, 0.2, 0.0]), [0.2, 0.0, 0.0])
    tree = tree_of(("cs", "cf", 5.2, end), ("cs", "cf", 5.0, start))
    found = tree.between("cs", "cf", 5.1)
    assert found is not None
    step = pose_inverse(start) @ found
    np.testing.assert_allclose(step, pose(rotation_exp([0.0, 0.1, 0.0]), [0.1, 0.0, 0.0]), atol=1e-9)


@pytest.mark.parametrize("t", [4.9, 5.3, 5.2 + 0.5 * (GAP + 0.1)])
def test_what_tf_does_not_tell_is_not_made_up(t: float) -> None:
    tree = tree_of(("cs", "cf", 5.0, C), ("cs", "cf", 5.2, C), ("cs", "cf", 5.3 + GAP, C))
    assert tree.between("cs", "cf", 5.1) is not None
    assert tree.between("cs", "cf", t) is None
    assert tree.between("cs", "elsewhere", 5.1) is None


def test_a_ring_and_too_much_of_all_end() -> None:
    tree = TransformTree()
    tree.take(tf(("a", "b", 1.0, A), ("b", "a", 1.0, B)), static=False)
    assert tree.between("a", "cs", 1.0) is None
    for k in range(2 * KEPT):
        tree.take(tf(("cs", "cf", float(k), A)), static=False)
    assert tree.between("cs", "cf", 1.0) is None
    with pytest.raises(DataError, match="leave some out"):
        tree.take(tf(*(("cs", f"frame{k}", 1.0, A) for k in range(FRAMES))), static=False)


def test_images_wait_for_their_pose() -> None:
    tree = TransformTree()
    stamps = WaitingStamps((0.03, 1.0), tree)
    stamps.add(5.0, "cf")
    stamps.add(5.05, "cf")
    assert stamps.known("cs") == []
    tree.take(tf(("cs", "cf", 4.95, C), ("cs", "cf", 5.02, C)), static=False)
    ((stamp, t_cf, covariance),) = stamps.known("cs")
    assert stamp == 5.0
    np.testing.assert_allclose(t_cf, C, atol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [0.03] * 3 + [np.deg2rad(1.0)] * 3)
    tree.take(tf(("cs", "cf", 5.1, C)), static=False)
    assert [t for t, _, _ in stamps.known("cs")] == [5.05]
    with pytest.raises(SettingsError, match="above 0"):
        WaitingStamps((0.0, 1.0), tree)


@pytest.fixture
def without_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch)


@pytest.mark.usefixtures("without_ros")
def test_a_node_finds_the_worn_camera_by_tf(clip: Clip) -> None:
    topics = RosTopics("/cs", "/cs_info", {"": WornTopics("/cf", "/cf_info", TF)})
    with pytest.raises(SettingsError, match="--t-cf-sd"):
        RosNode(Node(), topics, Settings.default())
    node = Node()
    topics = RosTopics("/cs", "/cs_info", {"": WornTopics("/cf", "/cf_info", TF, (0.03, 1.0))})
    running = RosNode(node, topics, Settings.default())
    node.takes["/cs_info"](messages.camera_info(0.0, "cs", clip.recording.camera))
    node.takes["/cf_info"](messages.camera_info(0.0, "cf", clip.recording.worn_camera))
    hold = messages.encoded(messages.TRANSFORMS, tf(("odom", "cs", 0.0, A)))
    node.takes[ros.TF_STATIC](hold)
    for count, frame in enumerate(clip.frames[:10]):
        t, worn = frame.t + 1.0, frame.views[0]
        node.takes["/cf"](messages.raw_image(t, "cf", worn.image))
        told = tf(("odom", "cf", t - 0.01, A @ worn.t_cf), ("odom", "cf", t + 0.01, A @ worn.t_cf))
        node.takes["/cs"](messages.raw_image(t, "cs", frame.image))
        node.takes[TF](messages.encoded(messages.TRANSFORMS, told))
        assert until(lambda count=count: len(node.sent["/collabslam/pose"]) >= count - 1)
    node.takes[TF](b"no message")
    running.close()
    assert len(node.sent["/collabslam/pose"]) >= 8
    last = messages.status_from(node.sent["/diagnostics"][-1])["robot"]
    assert last["metric"] == "True"
    assert last["refused"] == "0"
    links = messages.decoded(messages.TRANSFORMS, node.sent["/tf"][-1]).transforms
    in_map = messages.decoded(messages.POSE, node.sent["/collabslam/pose_map"][-1])
    assert [link.header.frame_id for link in links] == [in_map.header.frame_id, links[0].child_frame_id]


@pytest.mark.usefixtures("without_ros")
def test_a_node_hears_the_sensors_that_a_file_names(tmp_path: Path) -> None:
    topics: dict[Any, str] = {"robot": "/imu", "worn": "/glasses/imu"}
    scans = {name: f"/scan_{name}" for name in WornPoseConfig().scanners}
    write_sensors(tmp_path / "sensors.yaml", WornSensors(WornPoseConfig(), scans, topics))
    node, poses = Node(), f"{ESTIMATED}{tmp_path / 'sensors.yaml'}"
    worn = {"": WornTopics("/cf", "/cf_info", poses)}
    running = RosNode(node, RosTopics("/cs", "/cs_info", worn), Settings.default())
    assert {*topics.values(), *scans.values()} < node.takes.keys()
    for topic in (*topics.values(), *scans.values()):
        node.takes[topic](b"no message")
    assert running._refused == 4


@pytest.mark.usefixtures("without_ros")
@pytest.mark.parametrize("kind", [messages.ODOMETRY, messages.TWIST])
def test_a_node_follows_wheels_that_tf_places(clip: Clip, kind: str) -> None:
    odometry, node = wheels(clip), Node()
    given = OdometryGiven("/wheels", sd=(0.02, 0.01), frames=("base_link", "cs"))
    topic = WheelTopic(given, kind)
    running = RosNode(
        node, RosTopics("/cs", "/cs_info", wheels=topic), Settings.default(), mode="mono", start="odometry"
    )
    node.takes["/cs_info"](messages.camera_info(0.0, "cs", clip.recording.camera))
    assert running._live is None  # nobody has said where the camera sits
    chain = tf(("base_link", "mast", 0.0, A), ("mast", "cs", 0.0, pose_inverse(A) @ T_BC))
    node.takes[ros.TF_STATIC](messages.encoded(messages.TRANSFORMS, chain))
    live = running._live
    assert live is not None
    done, publish = [], live._on_pose
    live._on_pose = lambda pose: (done.append(pose.step), publish(pose))
    sent = 0
    for frame in clip.frames[:10]:
        while sent < len(odometry.times) and odometry.times[sent] <= frame.t + 0.02:
            t = float(odometry.times[sent]) + 1.0
            base = clip.recording.robot(t - 1.0) @ pose_inverse(T_BC)
            data = messages.odometry(t, base, np.eye(6))
            if kind == messages.TWIST:
                data = messages.twist(t, odometry.twists[sent], COVARIANCE)
            node.takes["/wheels"](data)
            sent += 1
        node.takes["/cs"](messages.raw_image(frame.t + 1.0, "cs", frame.image))
        assert until(lambda frame=frame: len(done) > frame.index)
    node.takes["/wheels"](b"no message")
    running.close()
    assert running._refused == 1
    assert live.refused == {}
    start, last = (clip.recording.truth[i] for i in (0, 9))
    way = done[-1].pose[:3, 3]
    np.testing.assert_allclose(way, (pose_inverse(start) @ last)[:3, 3], atol=0.1)


def test_samples_of_wheels_that_cannot_be_used() -> None:
    samples = WheelSamples(WheelTopic(OdometryGiven("/wheels", sd=(0.02, 0.01))))
    assert samples.take(messages.odometry(1.0, np.eye(4), np.eye(6))) is not None
    assert samples.take(messages.odometry(1.0, np.eye(4), np.eye(6))) is None
    found = samples.take(messages.odometry(1.1, pose(np.eye(3), [0.2, 0.0, 0.0]), np.eye(6)))
    assert found is not None
    np.testing.assert_allclose(found[1], [2.0, 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-9)
    silent = WheelSamples(WheelTopic(OdometryGiven("/wheels"), messages.TWIST))
    with pytest.raises(DataError, match="odometry-sd"):
        silent.take(messages.twist(1.0, np.zeros(6), np.zeros((6, 6))))

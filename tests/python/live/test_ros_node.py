"""A node as REP 105 wants it: map -> odom -> base_link, a twist, services; without a ROS that carries it."""

from __future__ import annotations

import ast
import re
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from helpers.clip import Clip

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from helpers.driven import T_BC, tf
from helpers.gyro import R_CI, of_clip
from helpers.rosless import Node, stand_in
from helpers.waiting import until

from collabslam import Camera, SettingsError
from collabslam.cli import live_ros, ros_parameters
from collabslam.datasets.imu.description import ImuFile
from collabslam.datasets.odometry import mounted
from collabslam.geometry import (
    fixed_to_tangent,
    pose_from_quaternion,
    pose_inverse,
    rotation_log,
    se3_exp,
    tangent_to_fixed,
)
from collabslam.level import GRAVITY, Level
from collabslam.live import messages
from collabslam.live.gyro_topic import GyroTopic
from collabslam.live.ros import MapFiles, RosNode, RosTopics
from collabslam.live.ros_frames import TF_MAP, Base, RosFrames
from collabslam.live.ros_out import KINDS, WORN_POSE, RosOut
from collabslam.live.ros_worn import WornTopics
from collabslam.results import GyroEstimate
from collabslam.settings.table import Settings, schema
from collabslam.slam import level_estimator
from collabslam.slam.map.saved_map import SavedMap
from collabslam.types import Array

MOUNT = (0.2, 0.0, 0.9, 0.0, 5.0, 0.0)
WORN = {"": WornTopics("/cf", "/cf_info", "/t_cf")}
PARAMETERS = Path(__file__).parents[3] / "ros" / "collabslam_ros" / "config" / "collabslam.yaml"


@pytest.fixture(autouse=True)
def without_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch)


def node_of(clip: Clip, maps: Any = MapFiles, **topics: Any) -> tuple[Any, RosNode]:
    """A node that knows both cameras."""
    node: Any = Node()
    running = RosNode(node, RosTopics("/cs", "/cs_info", WORN, **topics), Settings.default(), maps=maps)
    node.running = running
    node.takes["/cs_info"](messages.camera_info(0.0, "cs", clip.recording.camera))
    node.takes["/cf_info"](messages.camera_info(0.0, "cf", clip.recording.worn_camera))
    return node, running


def play(clip: Clip, node: Any, first: int, last: int, late: float = 0.0) -> None:
    """Frames of the clip with their views, each once the one before is done."""
    done: list[bool] = []
    out = node.running._out
    frame_done, out.frame = out.frame, lambda *told: (RosOut.frame(out, *told), done.append(True))
    for k, frame in enumerate(clip.frames[first:last], 1):
        t, worn = frame.t + 1.0, frame.views[0]
        node.takes["/t_cf"](messages.pose(t, "cs", worn.t_cf, worn.covariance))
        node.takes["/cf"](messages.raw_image(t, "cf", worn.image))
        node.takes["/cs"](messages.raw_image(t + late, "cs", frame.image))
        assert until(lambda k=k: len(done) == k)
    out.frame = frame_done


def pose_of(value: Any) -> Array:
    p, q = value.position, value.orientation
    return pose_from_quaternion([p.x, p.y, p.z], [q.w, q.x, q.y, q.z])


def link_of(link: Any) -> Array:
    p, q = link.transform.translation, link.transform.rotation
    return pose_from_quaternion([p.x, p.y, p.z], [q.w, q.x, q.y, q.z])


@pytest.mark.slow
def test_the_base_moves_in_odom_as_the_robot_did(clip: Clip) -> None:
    node, running = node_of(clip, frames=RosFrames(mount=MOUNT))
    play(clip, node, 0, 12)
    running.close()
    message = messages.decoded(messages.ODOMETRY, node.sent["/collabslam/odometry"][-1])
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
    t = messages.stamp_of(message) - 1.0
    first = messages.stamp_of(messages.decoded(messages.POSE, node.sent["/collabslam/pose"][0])) - 1.0
    bases = [clip.recording.robot(s) @ pose_inverse(T_BC) for s in (first, t)]
    true = pose_inverse(bases[0]) @ bases[1]
    found = pose_of(message.pose.pose)
    covariance = fixed_to_tangent(found, np.reshape(message.pose.covariance, (6, 6)))
    step = pose_inverse(found) @ true
    assert np.linalg.norm(step[:3, 3]) < 4.0 * np.sqrt(np.trace(covariance[:3, :3]))
    assert true[0, 3] > 0.5  # the robot drives along x
    moving, spread = message.twist.twist, np.reshape(message.twist.covariance, (6, 6))
    ahead = (
        clip.recording.robot(t - 0.05) @ pose_inverse(T_BC),
        clip.recording.robot(t + 0.05) @ pose_inverse(T_BC),
    )
    speed = (pose_inverse(ahead[0]) @ ahead[1])[:3, 3] / 0.1
    error = np.array([moving.linear.x, moving.linear.y, moving.linear.z]) - speed
    assert error @ np.linalg.solve(spread[:3, :3], error) < 16.3
    twist = messages.decoded(messages.TWIST, node.sent["/collabslam/twist"][-1])
    assert (twist.header.frame_id, twist.twist.twist.linear.x) == ("base_link", moving.linear.x)


def test_what_a_node_waits_for_is_said_once(clip: Clip) -> None:
    """Names of topics above all: whoever has misspelt one looks there."""
    node: Any = Node()
    running = node.running = RosNode(node, RosTopics("/cs", "/cs_info", WORN), Settings.default())
    for _ in range(2):
        node.look()
    assert node.said == ["waits for CameraInfo on /cs_info, /cf_info"]
    told = [messages.status_from(data)["robot"] for data in node.sent["/diagnostics"]]
    assert [one["waits for"] for one in told] == 2 * ["CameraInfo on /cs_info, /cf_info"]
    row = messages.decoded(messages.STATUS, node.sent["/diagnostics"][-1]).status[0]
    assert (row.level, row.message) == (1, "waits for CameraInfo on /cs_info, /cf_info")
    node.takes["/cs_info"](messages.camera_info(0.0, "cs", clip.recording.camera))
    assert running.waits_for() == "CameraInfo on /cf_info"
    node.takes["/cf_info"](messages.camera_info(0.0, "cf", clip.recording.worn_camera))
    node.look()
    assert node.said[1:] == ["waits for images on /cs"]
    node.takes["/cs"](messages.raw_image(0.5, "cs", clip.frames[0].image))
    assert until(lambda: running.waits_for() == "a view of /cf with /t_cf that shows what /cs does")
    play(clip, node, 0, 4)
    running.close()
    count = len(node.sent["/diagnostics"])
    for _ in range(2):
        node.look()
    assert node.said[2:] == ["publishes poses on /collabslam/odometry"]
    assert len(node.sent["/diagnostics"]) == count  # each frame has its own


@pytest.mark.slow
def test_tf_leads_from_map_over_odom_to_the_base(clip: Clip) -> None:
    node, running = node_of(clip)
    play(clip, node, 0, 6)
    running.close()
    links = messages.decoded(messages.TRANSFORMS, node.sent["/tf"][-1]).transforms
    assert [(k.header.frame_id, k.child_frame_id) for k in links] == [("map", "odom"), ("odom", "base_link")]
    in_map = messages.decoded(messages.POSE, node.sent["/collabslam/pose_map"][-1])
    np.testing.assert_allclose(link_of(links[0]) @ link_of(links[1]), pose_of(in_map.pose.pose), atol=1e-9)
    assert in_map.header.frame_id == "map"
    points, sd = messages.cloud_from(node.sent["/collabslam/map"][-1])
    assert (sd > 0.0).all()
    assert np.median(points[:, 0]) > 1.0  # ahead of the robot, as the camera looks


@pytest.mark.slow
def test_where_the_wheels_tell_odom_only_the_map_is_linked(clip: Clip) -> None:
    node, running = node_of(clip, frames=RosFrames(mount=MOUNT, tf=TF_MAP))
    drift = se3_exp([3.0, 1.0, 0.0, 0.0, 0.0, 0.7])
    for frame in clip.frames[:8]:
        t = frame.t + 1.0
        by_wheels = drift @ clip.recording.robot(frame.t) @ pose_inverse(T_BC)
        node.takes["/tf"](messages.encoded(messages.TRANSFORMS, tf(("odom", "base_link", t, by_wheels))))
    play(clip, node, 0, 8)
    running.close()
    (link,) = messages.decoded(messages.TRANSFORMS, node.sent["/tf"][-1]).transforms
    assert (link.header.frame_id, link.child_frame_id) == ("map", "odom")
    in_map = pose_of(messages.decoded(messages.POSE, node.sent["/collabslam/pose_map"][-1]).pose.pose)
    by_wheels = drift @ clip.recording.robot(clip.frames[7].t) @ pose_inverse(T_BC)
    np.testing.assert_allclose(link_of(link) @ by_wheels, in_map, atol=1e-6)
    pose = messages.decoded(messages.POSE, node.sent["/collabslam/pose"][-1])
    assert pose.header.frame_id == "collabslam_odom"  # not the wheels' own


@pytest.mark.slow
def test_links_of_tf_place_the_camera_and_latency_moves_stamps(clip: Clip) -> None:
    frames = RosFrames(mount=("base_link", "cs"))
    node, running = node_of(clip, frames=frames, latency=0.04)
    assert running._live is None
    chain = tf(
        ("base_link", "mast", 0.0, T_BC @ se3_exp([0, 0, 0.1, 0, 0, 0])),
        ("mast", "cs", 0.0, se3_exp([0, 0, -0.1, 0, 0, 0])),
    )
    node.takes["/tf_static"](messages.encoded(messages.TRANSFORMS, chain))
    assert running._live is not None
    play(clip, node, 0, 6, late=0.04)
    running.close()
    assert running._out.base is not None
    np.testing.assert_allclose(running._out.base.t_bc, T_BC, atol=1e-9)
    t, _, _ = messages.pose_from(node.sent["/collabslam/pose"][-1], "test")
    assert t == pytest.approx(clip.frames[5].t + 1.0, abs=1e-6)


@pytest.mark.slow
def test_services_save_a_map_start_in_it_and_begin_anew(clip: Clip, tmp_path: Path) -> None:
    files = [MapFiles()]
    node, running = node_of(clip, maps=lambda: files[0])
    assert node.ask("/collabslam/save_map") == (
        False,
        "No file was named for the map; say where it is to be saved (save_map).",
    )
    files[0] = MapFiles(tmp_path / "map", tmp_path / "map")
    ok, said = node.ask("/collabslam/save_map")
    assert (ok, "no map to save yet" in said) == (False, True)
    assert node.ask("/collabslam/start_in_map")[0] is False
    play(clip, node, 0, 10)
    assert node.ask("/collabslam/save_map") == (True, f"the map is in {tmp_path / 'map'}")
    saved = SavedMap.load(tmp_path / "map")
    assert node.ask("/collabslam/start_in_map")[0] is True
    live = running._live
    assert live is not None
    assert live.slam.filter.map_size == len(saved.landmarks)
    assert live.slam.filter.time is None
    count = len(node.sent["/collabslam/pose"])
    play(clip, node, 6, 10)
    assert len(node.sent["/collabslam/pose"]) > count  # it knows the place
    assert node.ask("/collabslam/reset") == (True, "it begins anew")
    assert running._live is not None
    assert running._live.slam.filter.map_size == 0
    play(clip, node, 0, 3)
    running.close()
    _, begun = node_of(clip, maps=lambda: files[0])
    assert begun._live is not None
    assert begun._live.slam.filter.map_size == len(
        saved.landmarks
    )  # a map that is named at first is started in
    begun.close()
    idle = Node()
    RosNode(idle, RosTopics("/cs", "/cs_info", WORN), Settings.default())
    assert "has not begun" in idle.ask("/collabslam/reset")[1]


@pytest.mark.slow
def test_poses_between_frames_are_the_gyroscopes(clip: Clip) -> None:
    log = of_clip(clip)
    topic = GyroTopic.of("/imu", None)
    node, running = node_of(clip, gyro=topic, frames=RosFrames(mount=MOUNT))
    link = tf(("cs", messages.GYRO, 0.0, np.block([[log.sensor.r_ci, np.zeros((3, 1))], [np.zeros(3), 1.0]])))
    node.takes["/imu"](messages.rate(0.5, log.rates[0]))
    node.takes["/tf_static"](messages.encoded(messages.TRANSFORMS, link))
    sent = 0
    for k in range(10):
        while sent < len(log.times) and log.times[sent] <= clip.frames[k].t + 0.09:
            node.takes["/imu"](messages.rate(float(log.times[sent]) + 1.0, log.rates[sent]))
            sent += 1
        if k:
            play(clip, node, k, k + 1)
    running.close()
    told = messages.status_from(node.sent["/diagnostics"][-1])["robot"]
    assert abs(float(told["latency_s"])) < 4.0 * float(told["latency_sd_s"])
    found = [
        messages.decoded(messages.ODOMETRY, data) for data in node.sent["/collabslam/odometry_propagated"]
    ]
    assert len(found) > 3 * len(node.sent["/collabslam/odometry"])
    first = messages.decoded(messages.POSE, node.sent["/collabslam/pose"][0])
    origin = clip.recording.robot(messages.stamp_of(first) - 1.0) @ pose_inverse(T_BC)
    last = found[-1]
    true = pose_inverse(origin) @ clip.recording.robot(messages.stamp_of(last) - 1.0) @ pose_inverse(T_BC)
    place = pose_of(last.pose.pose)
    covariance = fixed_to_tangent(place, np.reshape(last.pose.covariance, (6, 6)))
    assert np.linalg.norm((pose_inverse(place) @ true)[:3, 3]) < 4.0 * np.sqrt(np.trace(covariance[:3, :3]))


def test_the_latency_is_what_was_told_and_what_the_gyroscopes_clock_adds(clip: Clip) -> None:
    _, running = node_of(clip, latency=0.09)
    running.close()
    nothing = np.zeros(3)
    found = running._latency(GyroEstimate(nothing, nothing, 0.0032, 0.0011, True))
    assert found == {"latency_s": "0.0932", "latency_sd_s": "0.0011"}


def test_a_base_carries_errors_along() -> None:
    base, draw = Base(mounted(MOUNT)), np.random.default_rng(0)
    t_wc = se3_exp(draw.normal(size=6))
    root = 1e-4 * draw.normal(size=(6, 6))
    found = base.covariance(root @ root.T)
    errors = []
    for _ in range(4000):
        wrong = base.pose(t_wc @ se3_exp(root @ draw.normal(size=6)))
        step = pose_inverse(base.pose(t_wc)) @ wrong
        errors.append(
            [
                *step[:3, 3],
                0.5 * (step[2, 1] - step[1, 2]),
                0.5 * (step[0, 2] - step[2, 0]),
                0.5 * (step[1, 0] - step[0, 1]),
            ]
        )
    np.testing.assert_allclose(np.cov(np.array(errors).T), found, atol=0.08 * np.abs(found).max())
    np.testing.assert_allclose(tangent_to_fixed(np.eye(4), found), found, atol=1e-18)


def test_a_level_base_has_its_z_up_and_the_level_in_its_covariances() -> None:
    up = np.array([0.1, -0.95, -0.3]) / np.linalg.norm([0.1, -0.95, -0.3])
    level = Level(up, 0.02**2 * np.eye(2), "told")
    t_wc, covariance = se3_exp([4.0, -1.0, 7.0, 0.3, 0.5, -0.2]), 1e-4 * np.eye(6)
    for mount in ((0.0, 0.0, 0.0), MOUNT):
        t_bc = mounted(mount)
        base = Base(t_bc, level)
        above = base.points(np.array([[0.0, 0.0, 0.0], 2.0 * up]))
        np.testing.assert_allclose(above[1] - above[0], [0.0, 0.0, 2.0], atol=1e-12)
        begin = base.pose(np.eye(4))
        np.testing.assert_allclose(begin[:3, 3], 0.0, atol=1e-12)
        assert begin[0, 0] > 0.9  # x stays ahead
        assert begin[1, 0] == pytest.approx(0.0, abs=1e-12)
        place, spread = base.placed(t_wc, covariance)
        np.testing.assert_array_equal(place, base.pose(t_wc))
        wrong, sizes = [], 0.02 * np.random.default_rng(3).standard_normal((4000, 2))
        for x, y in sizes:
            step = pose_inverse(place) @ se3_exp([0, 0, 0, x, y, 0]) @ place
            wrong.append([*step[:3, 3], *rotation_log(step[:3, :3])])
        expected = base.covariance(covariance) + np.cov(np.array(wrong).T)
        np.testing.assert_allclose(spread, expected, atol=0.06 * np.abs(expected).max())
        points = np.array([[5.0, 1.0, 0.0]])
        added = base.spread(points, np.zeros((1, 3, 3)))[0]
        np.testing.assert_allclose(added, 0.02**2 * np.diag([0, 0, 26.0]), atol=1e-12)
        np.testing.assert_allclose(base.between(np.eye(4)), np.eye(4), atol=1e-12)


@pytest.mark.slow
def test_odom_is_level_once_an_accelerometer_has_told_it(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(level_estimator, "LEAST_WAY", 0.3)
    log = of_clip(clip)
    node, running = node_of(
        clip, gyro=GyroTopic("/imu", ImuFile(r_ci=R_CI)), frames=RosFrames(mount=MOUNT), is_level=True
    )
    node.takes["/imu"](messages.rate(0.5, log.rates[0]))
    sent = np.searchsorted(log.times, -0.1)
    noise = np.random.default_rng(5)
    frames = clip.frames[:14]
    for k, frame in enumerate(frames):
        while log.times[sent] <= frame.t + 0.02:
            t = float(log.times[sent])
            force = R_CI.T @ clip.recording.robot(t)[:3, :3].T @ [0.0, 0.0, GRAVITY]
            force += 0.02 * noise.standard_normal(3)
            node.takes["/imu"](messages.rate(t + 1.0, log.rates[sent], force))
            sent += 1
        play(clip, node, k, k + 1)
    running.close()
    found = [messages.decoded(messages.POSE, data) for data in node.sent["/collabslam/pose"]]
    assert 0 < len(found) < len(frames) - 5
    status = messages.decoded(messages.STATUS, node.sent["/diagnostics"][0]).status[0]
    assert "waits for" in {value.key for value in status.values}
    true = T_BC[:3, :3] @ clip.recording.robot(messages.stamp_of(found[-1]) - 1.0)[:3, :3].T @ [0, 0, 1]
    up = pose_of(found[-1].pose.pose)[2, :3]
    assert np.rad2deg(np.arccos(up @ true)) < 5.0
    assert found[-1].pose.covariance[3 * 6 + 3] > np.deg2rad(0.5) ** 2


def test_a_level_that_is_told_or_asked_for(clip: Clip) -> None:
    parser, words = ArgumentParser(), ["--cs", "/cs", "--cs-info", "/info"]
    live_ros.configure(parser)
    assert live_ros.told_level(parser.parse_args(words)) is None
    with pytest.raises(SettingsError, match="asks an accelerometer"):
        live_ros.told_level(parser.parse_args([*words, "--world", "level"]))
    with pytest.raises(SettingsError, match="is not known"):
        live_ros.told_level(parser.parse_args([*words, "--world", "flat"]))
    assert live_ros.told_level(parser.parse_args([*words, "--world", "level", "--gyro", "/imu"])) is None
    told = live_ros.told_level(parser.parse_args([*words, "--world", "level:0,5"]))
    _, running = node_of(clip, is_level=True, told=told)
    assert running._out.base is not None
    ahead = running._out.base.pose(np.eye(4))[:3, 0]
    np.testing.assert_allclose(ahead, [np.cos(np.deg2rad(5.0)), 0.0, -np.sin(np.deg2rad(5.0))], atol=1e-9)
    running.close()
    _, waits = node_of(clip, is_level=True)
    assert waits._out.base is None
    waits.close()


def test_the_parameters_are_the_options_and_the_settings() -> None:
    assert PARAMETERS.read_text() == ros_parameters.parameters_text()  # python packaging/ros_parameters.py
    given = ros_parameters.arguments_of(
        {"cs": "/a", "cs_info": "/b", "cf": ["anna=/c", ""], "cf_info": ["anna=/d"], "t_cf": ["anna=/e"]}
        | {"base": "-0.1,0,0.5", "tf": "map", "propagate": 50.0, "map": ""}
    )
    assert (given.cs, given.cf, given.base, given.tf) == ("/a", [("anna", "/c")], (-0.1, 0.0, 0.5), "map")
    assert (given.propagate, given.map) == (50.0, None)
    mounted_on = {"cs": "/a", "cs_info": "/b", "twist": "/w", "base": "0.2,0,0.9"}
    assert live_ros.with_mounts(ros_parameters.arguments_of(mounted_on)).odometry_camera == (0.2, 0.0, 0.9)
    apart = live_ros.with_mounts(ros_parameters.arguments_of(mounted_on | {"odometry_camera": "1,0,0"}))
    assert (apart.odometry_camera, apart.base) == ((1.0, 0.0, 0.0), (0.2, 0.0, 0.9))
    key = "filter.process.acceleration_density"
    value = 2.0 * float(schema()[key].default)
    assert ros_parameters.settings_of({key: value, "cs": "/a"}).filter.process.acceleration_density == value
    with pytest.raises(SettingsError, match="cs"):
        ros_parameters.arguments_of({"cs": "/a"})
    with pytest.raises(SettingsError, match=key):
        ros_parameters.settings_of({key: -1.0})


def test_what_the_package_names_is_there() -> None:
    """Arguments of launch files are parameters; views show topics that the node publishes."""
    package = PARAMETERS.parents[1]
    tree = ast.parse((package / "collabslam_ros" / "launching.py").read_text())
    tables = {n.target.id: n.value for n in tree.body if isinstance(n, ast.AnnAssign)}  # type: ignore[union-attr]
    robot, worn = (ast.literal_eval(tables[name]) for name in ("ROBOT", "WORN"))  # type: ignore[arg-type]
    for given in (robot, {**robot, **worn}):
        assert given.keys() <= ros_parameters.options().keys()
        ros_parameters.arguments_of({name: value for name, (value, _) in given.items()})
    for path in sorted((package / "launch").glob("*.py")):
        (brought,) = (n for n in ast.parse(path.read_text()).body if isinstance(n, ast.ImportFrom))
        assert brought.module == "collabslam_ros.launching"
        assert {name.name for name in brought.names} <= {*tables, "node_with"}
    topics = {f"/collabslam/{name}" for name in (*KINDS, WORN_POSE)}
    for path in (package / "rviz" / "collabslam.rviz", package / "foxglove" / "collabslam.json"):
        yaml.safe_load(path.read_text())  # JSON is YAML
        shown = set(re.findall(r"/collabslam/\w+", path.read_text()))
        assert shown
        assert shown <= topics


@pytest.mark.parametrize("topic", ["/cs/compressed", "/cf/compressed"])
@pytest.mark.parametrize(("size", "scans"), [((480, 640), 1), ((48, 64), 17)])
def test_compressed_pictures_are_of_the_calibration(
    topic: str, size: tuple[int, int], scans: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None other is decoded: frames of Cs would wait for it."""
    node: Any = Node()
    worn = {"": WornTopics("/cf/compressed", "/cf_info", "/t_cf")}
    running = RosNode(node, RosTopics("/cs/compressed", "/cs_info", worn), Settings.default())
    camera = Camera("pinhole", 64, 48, (50.0, 50.0, 32.0, 24.0))
    for info in ("/cs_info", "/cf_info"):
        node.takes[info](messages.camera_info(0.0, "c", camera))
    monkeypatch.setattr("collabslam.datasets.images._decoded", lambda *_: pytest.fail("it is decoded"))
    picture = bytes(cv2.imencode(".jpg", np.zeros(size, np.uint8))[1])
    scan = picture[picture.index(b"\xff\xda") : -2]
    picture = picture[:-2] + scan * (scans - 1) + picture[-2:]
    node.takes[topic](messages.compressed_image(1.0, "c", picture))
    assert running._refused == 1
    running.close()

"""Several persons at a node of ROS 2: topics of each, T_CF of each from where it comes, no ROS needed."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helpers.clip import Clip

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from helpers.driven import tf
from helpers.rosless import Node, stand_in
from helpers.waiting import until

from collabslam import Camera, Settings, SettingsError
from collabslam.cli import live_ros
from collabslam.cli.options import of_person
from collabslam.datasets.odometry import mounted
from collabslam.datasets.ros.sensors import ESTIMATED, WornSensors, write_sensors
from collabslam.geometry import pose_inverse
from collabslam.live import messages
from collabslam.live.ros import RosNode, RosTopics
from collabslam.live.ros_worn import TF, WornTopics
from collabslam.worn_pose import WornPoseConfig

ANNA = WornTopics("/anna/image/compressed", "/anna/info", "/anna/t_cf")
BEN = WornTopics("/ben/image", "/ben/info", TF, (0.03, 1.0))
FRAMES = 8
BENS = [2, 4, 6]
"""Frames that Ben sees, too."""


@pytest.fixture(autouse=True)
def without_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch)


def node_of(worn: dict[str, WornTopics]) -> tuple[Node, RosNode]:
    node = Node()
    return node, RosNode(node, RosTopics("/cs", "/cs_info", worn), Settings.default())


def test_each_has_images_and_a_pose_of_their_own(clip: Clip) -> None:
    """Anna's T_CF is a topic and she sees every frame; Ben's comes by tf, and he sees three."""
    node, running = node_of({"anna": ANNA, "ben": BEN})
    base = clip.recording
    node.takes["/cs_info"](messages.camera_info(0.0, "cs", base.camera))
    for topics in (ANNA, BEN):
        node.takes[topics.info](messages.camera_info(0.0, "cf", base.worn_camera))
    live = running._live
    assert live is not None
    publish, done = live._on_pose, []
    live._on_pose = lambda pose: (publish(pose), done.append(pose))
    sent = {name: node.sent[f"/collabslam/worn_pose/{name}"] for name in ("anna", "ben")}
    for count, frame in enumerate(clip.frames[:FRAMES]):
        t, worn = frame.t + 1.0, frame.views[0]
        node.takes[ANNA.t_cf](messages.pose(t, "cs", worn.t_cf, worn.covariance))
        jpeg = cv2.imencode(".jpg", worn.image)[1].tobytes()
        node.takes[ANNA.images](messages.compressed_image(t, "anna", jpeg))
        if count in BENS:
            node.takes[BEN.images](messages.raw_image(t, "ben", worn.image))
            around = (("cs", "ben", t + late, worn.t_cf) for late in (-0.01, 0.01))
            node.takes[TF](messages.encoded(messages.TRANSFORMS, tf(*around)))
        node.takes["/cs"](messages.raw_image(t, "cs", frame.image))
        assert until(lambda count=count: len(done) > count)
    node.takes[ANNA.t_cf](b"no message")
    running.close()
    assert running._refused == 1
    assert len(sent["anna"]) >= FRAMES - 1  # that of the start may not count as measured
    assert len(sent["ben"]) == len(BENS)
    told = messages.status_from(node.sent["/diagnostics"][0])
    assert {"robot", "anna", "ben"} == told.keys()
    for i, data in zip(BENS, sent["ben"], strict=True):
        t, place, covariance = messages.pose_from(data, "test")
        true = mounted((0.0, 0.0, 0.0)) @ pose_inverse(base.truth[0]) @ base.truth[i] @ base.true_t_cf(i)
        assert t == pytest.approx(clip.frames[i].t + 1.0)
        sd = np.sqrt(np.trace(covariance[:3, :3]))
        assert np.linalg.norm(place[:3, 3] - true[:3, 3]) < 4.0 * sd + 0.02


def test_the_filter_begins_once_all_have_told_their_calibration(clip: Clip) -> None:
    node, running = node_of({"anna": ANNA, "ben": BEN})
    anna = clip.recording.worn_camera
    ben = Camera("pinhole", anna.width, anna.height, [1.1 * f for f in anna.intrinsics])
    node.takes[BEN.info](messages.camera_info(0.0, "cf", ben))
    node.takes["/cs_info"](messages.camera_info(0.0, "cs", clip.recording.camera))
    assert running._live is None
    node.takes[ANNA.info](messages.camera_info(0.0, "cf", anna))
    assert running._live is not None
    cameras = running._live.slam.worn_cameras
    assert list(cameras) == ["anna", "ben"]
    assert cameras["ben"].intrinsics == pytest.approx(ben.intrinsics)
    assert cameras["anna"].intrinsics == pytest.approx(anna.intrinsics)
    running.close()


def test_what_can_be_of_one_alone_is_not_of_two(tmp_path: Path) -> None:
    ahrs: dict[Any, str] = {"robot": "/imu", "worn": "/glasses/imu"}
    scans = {name: f"/scan_{name}" for name in WornPoseConfig().scanners}
    write_sensors(tmp_path / "sensors.yaml", WornSensors(WornPoseConfig(), scans, ahrs))
    sensed = f"{ESTIMATED}{tmp_path / 'sensors.yaml'}"
    for one, two, topic in (
        (ANNA, WornTopics(ANNA.images, "/ben/info", "/ben/t_cf"), "/anna/image/compressed"),
        (ANNA, WornTopics("/ben/image", "/ben/info", ANNA.t_cf), "/anna/t_cf"),
        (WornTopics("/a", "/b", sensed), WornTopics("/c", "/d", sensed), "/glasses/imu"),
    ):
        with pytest.raises(SettingsError, match=f"{topic} was given for anna and for ben"):
            node_of({"anna": one, "ben": two})
    with pytest.raises(SettingsError, match="NAME=METRES,DEGREES"):
        node_of({"anna": ANNA, "ben": WornTopics("/ben/image", "/ben/info", TF)})


def asked(*options: str) -> dict[str, WornTopics]:
    parser = argparse.ArgumentParser(exit_on_error=False)
    live_ros.configure(parser)
    words = [word for option in options for word in option.split(" ")]
    return live_ros.worn_topics(parser.parse_args(["--cs", "/cs", "--cs-info", "/info", *words]))


def test_options_of_each() -> None:
    assert asked() == {}
    alone = asked("--cf /cf", "--cf-info /cf_info", "--t-cf /tf", "--t-cf-sd 0.03,1.0")
    assert alone == {"": WornTopics("/cf", "/cf_info", "/tf", (0.03, 1.0))}
    both = asked(
        *(f"--cf {name}=/{name}/image --cf-info {name}=/{name}/info" for name in ("anna", "ben")),
        "--t-cf ben=sensors:b=c.yaml --t-cf anna=/tf",
        "--t-cf-sd anna=0.1,2",
    )
    assert both == {
        "anna": WornTopics("/anna/image", "/anna/info", "/tf", (0.1, 2.0)),
        "ben": WornTopics("/ben/image", "/ben/info", "sensors:b=c.yaml"),
    }
    assert of_person(str)("sensors:/a=b.yaml") == ("", "sensors:/a=b.yaml")
    assert of_person(Path)("/a=b/c.yaml") == ("", Path("/a=b/c.yaml"))


WHOLE = "--cf anna=/a --cf-info anna=/b --t-cf anna=/c"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--cf /cf --cf-info /cf_info", "A worn camera needs .* has no --t-cf;"),
        ("--cf anna=/a --t-cf anna=/c", "of anna needs .* has no --cf-info;"),
        (f"{WHOLE} --t-cf clara=/t_cf", "of clara needs .* has no --cf, --cf-info;"),
        (f"{WHOLE} --t-cf-sd clara=0.03,1", "of clara needs"),
        (f"{WHOLE} --cf anna=/d", "--cf was given twice for anna"),
        ("--cf /a --cf /b --cf-info /c --t-cf /d", "--cf was given twice;"),
        (f"{WHOLE} --cf /b", "give every option as NAME="),
        ("--cf Anna=/a --cf-info Anna=/b --t-cf Anna=/c", "cannot be called 'Anna'"),
    ],
)
def test_options_that_do_not_fit_are_named(options: str, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        asked(options)

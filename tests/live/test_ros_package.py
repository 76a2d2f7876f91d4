"""The ROS 2 package's node with a real ROS 2: two recordings go in as topics, odometry and tf come out."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not there: make test-live installs it for Python 3.11")

import cv2
import rclpy
from std_srvs.srv import Trigger

from collabslam.datasets.odometry import mounted
from collabslam.errors import DataError
from collabslam.geometry import fixed_to_tangent, pose_from_quaternion, pose_inverse
from collabslam.live import messages
from collabslam.live.ros_types import message_class
from collabslam.simulation import corridor_recording
from collabslam.slam.map.saved_map import SavedMap
from collabslam.types import Array

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the parsers that rclpy brings

HERE = Path(__file__).parent
PACKAGE = HERE.parents[1] / "ros" / "collabslam_ros"
DEBIAN = Path("/usr/lib/python3/dist-packages")
"""Where Debian's python3-tf2 is."""
FRAMES, SOON = 14, 20.0
MOUNT = (0.2, 0.0, 0.9, 0.0, 5.0, 0.0)
IN = {
    "/cs/image_raw": messages.IMAGE,
    "/cs/camera_info": messages.CAMERA_INFO,
    "/cf/image/compressed": messages.COMPRESSED,
    "/cf/camera_info": messages.CAMERA_INFO,
    "/t_cf": messages.POSE,
    "/cf/imu": messages.IMU,
}
OUT = {
    "/collabslam/odometry": messages.ODOMETRY,
    "/collabslam/pose_map": messages.POSE,
    "/collabslam/map": messages.CLOUD,
    "/diagnostics": messages.STATUS,
    "/tf": messages.TRANSFORMS,
}


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))  # no other node's business
    rclpy.init(args=[])
    made = rclpy.create_node("cameras")
    yield made
    made.destroy_node()
    rclpy.shutdown()


def asked(node: Any, name: str) -> tuple[bool, str]:
    """Success and message of a service."""
    client = node.create_client(Trigger, f"/collabslam/{name}")
    assert client.wait_for_service(timeout_sec=SOON)
    future = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=3.0 * SOON)
    answer = future.result()
    return bool(answer.success), str(answer.message)


def by_tf2(links: list[list[Any]], ask: list[tuple[str, str, float]]) -> list[Array]:
    """Poses as tf2's buffer has them."""
    command = [sys.executable, str(HERE / "tf2_buffer.py"), str(DEBIAN)]
    content = json.dumps({"links": links, "ask": ask})
    alone = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(command, input=content, capture_output=True, text=True, check=False, env=alone)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout.splitlines()[-1])
    return [pose_from_quaternion(row[:3], [row[6], *row[3:6]]) for row in rows]


def test_two_cameras_in_and_the_robot_in_tf(node: Any, tmp_path: Path) -> None:
    recording = corridor_recording()
    frames = [recording.frame(i) for i in range(FRAMES)]
    given = {"cs": "/cs/image_raw", "cs_info": "/cs/camera_info", "base": ",".join(map(str, MOUNT))}
    given |= {"save_map": str(tmp_path / "map"), "map": ""}
    several = {"cf": "/cf/image/compressed", "cf_info": "/cf/camera_info", "t_cf": "/t_cf"}
    several |= {"worn_gyro": "/cf/imu", "worn_imu": "optical"}
    command = [sys.executable, "-m", "collabslam_ros.node", "--ros-args"]
    command += ["--params-file", str(PACKAGE / "config" / "collabslam.yaml")]
    command += [w for k, v in given.items() for w in ("-p", f"{k}:='{v}'")]
    command += [w for k, v in several.items() for w in ("-p", f"{k}:=['{v}']")]
    paths = os.pathsep.join([str(PACKAGE), *sys.path])
    process = subprocess.Popen(command, stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": paths})
    heard: dict[str, list[bytes]] = {topic: [] for topic in OUT}
    for topic, kind in OUT.items():
        try:
            of = message_class(kind)
        except DataError:
            continue  # a small ROS lacks it: said below
        node.create_subscription(
            of, topic, lambda data, topic=topic: heard[topic].append(bytes(data)), 50, raw=True
        )
    out = {topic: node.create_publisher(message_class(kind), topic, 10) for topic, kind in IN.items()}
    poses = heard["/collabslam/odometry"]
    try:
        end = time.monotonic() + 3.0 * SOON
        while any(p.get_subscription_count() == 0 for p in out.values()) and time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.1)
        for _ in range(10):  # as cameras do, again and again
            out["/cs/camera_info"].publish(messages.camera_info(0.0, "cs", recording.camera))
            out["/cf/camera_info"].publish(messages.camera_info(0.0, "cf", recording.worn_camera))
            rclpy.spin_once(node, timeout_sec=0.1)
        for frame in frames:
            t, worn = frame.t + 1.0, frame.views[0]
            jpeg = cv2.imencode(".jpg", worn.image)[1].tobytes()
            out["/cf/imu"].publish(messages.rate(t - 0.002, np.array([0.01, 0.02, 0.0]), frame="cf_imu"))
            out["/t_cf"].publish(messages.pose(t, "cs", worn.t_cf, worn.covariance))
            out["/cf/image/compressed"].publish(messages.compressed_image(t, "cf", jpeg))
            out["/cs/image_raw"].publish(messages.raw_image(t, "cs", frame.image))
            until, before = time.monotonic() + (SOON if poses else 1.0), len(poses)
            while time.monotonic() < until and len(poses) == before:
                rclpy.spin_once(node, timeout_sec=0.02)
        saved = asked(node, "save_map")
        begun = asked(node, "reset")
    finally:
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=3.0 * SOON)
    assert process.returncode == 0, said.decode()
    assert saved == (True, f"the map is in {tmp_path / 'map'}")
    assert len(SavedMap.load(tmp_path / "map").landmarks) > 20
    assert begun[0]
    assert len(poses) >= FRAMES // 3  # ROS lets images fall that a busy machine does not take
    _check_odometry(poses, recording)
    assert heard["/collabslam/map"]
    told = messages.status_from(heard["/diagnostics"][-1])["robot"]
    assert told["metric"] == "True"
    assert re.search(
        "turn it told: [1-9]", told["gyroscope of Cf"]
    )  # samples and images go ways of their own
    _check_tf(heard["/tf"], poses[-1], heard["/collabslam/pose_map"])


def _check_odometry(poses: list[bytes], recording: Any) -> None:
    """From the second pose to the last, as the robot's base went; and how fast."""
    first, last = (messages.decoded(messages.ODOMETRY, poses[k]) for k in (1, -1))
    assert (last.header.frame_id, last.child_frame_id) == ("odom", "base_link")
    camera = pose_inverse(mounted(MOUNT))
    bases = [recording.truth[round((messages.stamp_of(m) - 1.0) * 10.0)] @ camera for m in (first, last)]
    true, found = pose_inverse(bases[0]) @ bases[1], pose_inverse(_pose(first)) @ _pose(last)
    assert np.linalg.norm(true[:3, 3]) > 0.3
    assert np.linalg.norm(found[:3, 3] - true[:3, 3]) < 0.15
    covariance = fixed_to_tangent(_pose(last), np.reshape(last.pose.covariance, (6, 6)))
    assert np.linalg.eigvalsh(covariance)[0] > 0.0
    speed = np.linalg.norm(true[:3, 3]) / (messages.stamp_of(last) - messages.stamp_of(first))
    assert last.twist.twist.linear.x == pytest.approx(speed, abs=0.3)
    assert np.linalg.eigvalsh(np.reshape(last.twist.covariance, (6, 6)))[0] > 0.0


def _check_tf(heard: list[bytes], last: bytes, in_map: list[bytes]) -> None:
    """tf2's buffer finds the base where the messages have it."""
    if not heard:
        pytest.skip("this ROS has no tf2_msgs: make test-live builds them where cmake is")
    if not (DEBIAN / "tf2_py").is_dir():
        pytest.skip("tf2 is not there: apt install python3-tf2")
    links = []
    for data in heard:
        for k in messages.decoded(messages.TRANSFORMS, data).transforms:
            p, q = k.transform.translation, k.transform.rotation
            numbers = [float(v) for v in (p.x, p.y, p.z, q.x, q.y, q.z, q.w)]
            links.append([k.header.frame_id, k.child_frame_id, messages.stamp_of(k), *numbers])
    message = messages.decoded(messages.ODOMETRY, last)
    mapped = messages.decoded(messages.POSE, in_map[-1])
    t = messages.stamp_of(message)
    odom, whole = by_tf2(links, [("odom", "base_link", t), ("map", "base_link", messages.stamp_of(mapped))])
    np.testing.assert_allclose(odom, _pose(message), atol=1e-6)
    np.testing.assert_allclose(whole, _pose(mapped), atol=1e-6)


def _pose(message: Any) -> Array:
    p, q = message.pose.pose.position, message.pose.pose.orientation
    return pose_from_quaternion([p.x, p.y, p.z], [q.w, q.x, q.y, q.z])

"""A real node of ROS 2 sends images and receives the pose."""

from __future__ import annotations

import os
import signal
import socket
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
from scenario import frames_of

from collabslam.datasets.odometry import mounted
from collabslam.live import messages
from collabslam.live.ros_types import message_class
from collabslam.simulation import corridor_recording

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the parsers that rclpy brings

TOPICS = {
    "--cs": "/cs/image_raw",
    "--cs-info": "/cs/camera_info",
    "--cf": "/cf/image/compressed",
    "--cf-info": "/cf/camera_info",
    "--t-cf": "/t_cf",
}
FRAMES = 14
SOON = 20.0
"""Seconds in which the node does what it should, however busy the machine."""


def test_images_in_and_the_pose_out(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = corridor_recording()
    frames = [recording.frame(i) for i in range(FRAMES)]
    command = [
        sys.executable,
        "-m",
        "collabslam",
        "live",
        "ros",
        *(w for pair in TOPICS.items() for w in pair),
    ]
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))  # no other node's business
    rclpy.init(args=[])
    node = rclpy.create_node("cameras")
    process = subprocess.Popen(command, stderr=subprocess.PIPE)
    poses: list[bytes] = []
    kept = node.create_subscription(
        message_class(messages.POSE), "/collabslam/pose", lambda data: poses.append(bytes(data)), 10, raw=True
    )
    kinds = {
        "--cs": messages.IMAGE,
        "--cs-info": messages.CAMERA_INFO,
        "--cf": messages.COMPRESSED,
        "--cf-info": messages.CAMERA_INFO,
        "--t-cf": messages.POSE,
    }
    out: dict[str, Any] = {
        role: node.create_publisher(message_class(kinds[role]), topic, 10) for role, topic in TOPICS.items()
    }
    try:
        end = time.monotonic() + 3.0 * SOON
        while any(p.get_subscription_count() == 0 for p in out.values()) and time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.1)
        for _ in range(10):  # as cameras do, again and again
            out["--cs-info"].publish(messages.camera_info(0.0, "cs", recording.camera))
            out["--cf-info"].publish(messages.camera_info(0.0, "cf", recording.worn_camera))
            time.sleep(0.1)
        for frame in frames:
            t, worn = frame.t + 1.0, frame.views[0]
            jpeg = cv2.imencode(".jpg", worn.image)[1].tobytes()
            out["--t-cf"].publish(messages.pose(t, "cs", worn.t_cf, worn.covariance))
            out["--cf"].publish(messages.compressed_image(t, "cf", jpeg))
            out["--cs"].publish(messages.raw_image(t, "cs", frame.image))
            until, before = time.monotonic() + (SOON if poses else 1.0), len(poses)
            while time.monotonic() < until and len(poses) == before:  # a busy machine is slower than a camera
                rclpy.spin_once(node, timeout_sec=0.02)
    finally:
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=3.0 * SOON)
        node.destroy_subscription(kept)
        node.destroy_node()
        rclpy.shutdown()
    assert process.returncode == 0, said.decode()
    assert len(poses) >= FRAMES // 3  # ROS lets images fall that a busy machine does not take
    # From the second pose to the last: ROS may lose the first images, and W is of the first frame with a
    # view. The first pose may be W's own, which has no error and so no covariance that can be read.
    began, first, _ = messages.pose_from(poses[1], "test")
    t, last, covariance = messages.pose_from(poses[-1], "test")
    from_frame, to_frame = (recording.truth[round((at - 1.0) * 10.0)] for at in (began, t))
    true = np.linalg.inv(from_frame) @ to_frame
    # The poses are of the base, in which Cs sits and looks ahead.
    t_bc = mounted((0.0, 0.0, 0.0))
    moved = np.linalg.inv(t_bc) @ np.linalg.inv(first) @ last @ t_bc
    assert t - began > 0.3
    assert np.linalg.norm(moved[:3, 3] - true[:3, 3]) < 0.15
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


def test_a_topic_is_the_robots_camera(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    recording = corridor_recording()
    images = [recording.image(i) for i in range(FRAMES)]
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    command = [sys.executable, "-m", "collabslam", "live", "robot", "ros:/cs/image_raw", "--insecure"]
    command += ["--listen", f"127.0.0.1:{port}", "--out", str(tmp_path / "out")]
    command += ["--mode", "mono", "--start", "scale-free"]
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(101 + os.getpid() % 100))
    rclpy.init(args=[])
    node = rclpy.create_node("camera")
    info = node.create_publisher(message_class(messages.CAMERA_INFO), "/cs/camera_info", 10)
    out = node.create_publisher(message_class(messages.IMAGE), "/cs/image_raw", 10)
    process = subprocess.Popen(command, stderr=subprocess.PIPE)
    stamps = []
    try:
        end = time.monotonic() + 3.0 * SOON
        while out.get_subscription_count() == 0 and time.monotonic() < end:
            time.sleep(0.1)
        for image in images:
            stamps.append(time.time())
            info.publish(messages.camera_info(stamps[-1], "cs", recording.camera))
            out.publish(messages.raw_image(stamps[-1], "cs", image))
            before, until = len(frames_of(tmp_path / "out")), time.monotonic() + SOON
            while len(frames_of(tmp_path / "out")) == before and time.monotonic() < until:
                time.sleep(0.05)
                if before == 0:  # until it has its calibration
                    info.publish(messages.camera_info(time.time(), "cs", recording.camera))
                    stamps.append(time.time())
                    out.publish(messages.raw_image(stamps[-1], "cs", image))
    finally:
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=3.0 * SOON)
        node.destroy_node()
        rclpy.shutdown()
    assert process.returncode == 0, said.decode()
    times = [t for t, _ in frames_of(tmp_path / "out")]
    assert len(times) >= FRAMES // 3
    assert np.abs(np.subtract.outer(times, stamps)).min(axis=1).max() < 1e-6

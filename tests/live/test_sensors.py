"""Sensors over the link: a bag's two halves at two ends, and nothing but scans and attitudes tells T_CF."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("zenoh", reason="the extra live is not installed")

from scenario import frames_of, position_error

from collabslam.datasets.ros.sensors import WornSensors, write_sensors
from collabslam.datasets.ros.writer import AHRS_TOPICS, SCAN_TOPIC, write_bag
from collabslam.datasets.wrapped import FirstFrames
from collabslam.live.replay import replay
from collabslam_lab.worlds.recording import world_recording
from collabslam_lab.worlds.sensors import config_of, readings_of

FRAMES = 60


def test_the_robot_estimates_where_the_worn_camera_is(tmp_path: Path) -> None:
    world = world_recording("turn90-0")
    first = FirstFrames(world, FRAMES)
    read, config = readings_of(world, 0), config_of(world)
    end = float(first.times[-1]) + 0.5
    bag, file = tmp_path / "bag", tmp_path / "sensors.yaml"
    scans, attitudes = ([r for r in found if r.t < end] for found in (read.scans, read.attitudes))
    write_bag(first, bag, scans=scans, attitudes=attitudes, storage="mcap")
    topics = {name: SCAN_TOPIC.format(name) for name in config.scanners}
    write_sensors(file, WornSensors(config, topics, dict(AHRS_TOPICS)))
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{s.getsockname()[1]}"
    own = {
        "robot": ["cs=/cs/image_raw", "--listen", address, "--out", "out", "--record", "record"],
        "worn": ["cs=/cf/image_raw", "--robot", address],
    }
    ends = []
    for role, options in own.items():
        command = [sys.executable, "-m", "collabslam", "live", role, str(bag), "--insecure"]
        command += ["--sensors", str(file), "--topics", *options]
        ends.append(subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE))
    try:
        for process in ends:
            _, said = process.communicate(timeout=120.0)
            assert process.returncode == 0, said.decode()
    finally:
        for process in ends:
            process.kill()
            process.wait()
    out = tmp_path / "out"
    links = [link for _, link in frames_of(out)]
    assert links.count("collab") > len(links) // 3  # a busy machine is late with some
    summary = json.loads((out / "summary.json").read_text())
    assert "dropped no sensors file" not in summary
    assert "dropped malformed" not in summary
    assert position_error(out, first.times, first.truth) < 0.5
    replay(tmp_path / "record", tmp_path / "again")
    for name in ("trajectory.tum", "trajectory.cov"):
        assert (tmp_path / "again" / name).read_bytes() == (out / name).read_bytes()

"""A person in a corridor as laser scans and AHRSs tell of them, as arrays and as a bag."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from helpers.bags import Maker

from collabslam.worn_pose import AHEAD_LEFT_UP, AhrsReading, LaserScan, WornPoseConfig
from collabslam_lab.worn_sensors import (
    AhrsModel,
    FloorPlan,
    Walker,
    box,
    camera_attitude,
    polyline,
    sensor_times,
    simulate_ahrs,
    simulate_scans,
    table,
)

SECONDS = 7.0
WALLS = polyline([[-4, -1.6], [14, -1.6], [14, 1.6], [-4, 1.6]], closed=True)
PLAN = FloorPlan(
    np.concatenate([WALLS, box(5, 1.3, 0.8, 0.5)]),
    np.concatenate([table(6.0, -1.0, 0.5, 0.5), table(3.0, 1.1, 0.4, 0.4, 0.3)]),
)
STAMPS = np.arange(-0.02, SECONDS + 0.04, 0.02)


def robot(t: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = camera_attitude(0.15 * np.sin(t), 0.0, 0.0)
    pose[:3, 3] = (0.9 * t, 0.0, 0.95)
    return pose


def walker() -> Walker:
    path = np.column_stack([2.0 + 0.9 * STAMPS, 0.25 * np.sin(0.8 * STAMPS)])
    gaze = np.column_stack([0.4 * np.sin(STAMPS), np.full(len(STAMPS), -0.1)])
    return Walker(STAMPS, path, gaze)


@lru_cache(maxsize=2)
def sensors(there: bool = True) -> tuple[list[LaserScan], list[AhrsReading]]:
    """Scans and readings of a corridor, with the person or without."""
    rng, person, config = np.random.default_rng(5), walker(), WornPoseConfig()
    scans: list[LaserScan] = []
    for name, phase in (("front", 0.0), ("back", 0.02)):
        times = sensor_times(0.0, SECONDS, 25.0, phase)
        legs = person.legs if there else None
        scans += simulate_scans(PLAN, times, robot, config.scanners[name], legs, rng=rng, scanner=name)
    times = sensor_times(0.0, SECONDS, 100.0)
    model = AhrsModel(tilt=1e-4, yaw=1e-4, white=1e-4)
    readings = simulate_ahrs(times, robot, AHEAD_LEFT_UP, rng=rng, where="robot", model=model)
    readings += simulate_ahrs(times, person.camera, AHEAD_LEFT_UP, rng=rng, where="worn", model=model)
    return scans, readings


SENSORS = {
    "scanners": {
        "front": {"topic": "/scan", "ahead": 0.05, "up": -0.65},
        "back": {"topic": "/scan_back", "ahead": -0.45, "up": -0.65, "heading_deg": 180.0},
    },
    "ahrs": {"robot": {"topic": "/imu"}, "worn": {"topic": "/head/imu"}},
    "camera_height": 0.95,
    "person": {"camera_height": 1.7, "neck_to_camera": [0.0, -0.1, 0.1]},
    "ahrs_errors": {"yaw_sd_deg": 1.0},
    "start": [0.0, 2.0],
}


def write_sensor_bag(path: Path) -> Path:
    """Images of both cameras, scans and attitudes of the corridor, as a ROS 1 bag."""
    maker = Maker(path, "ros1")
    scans, readings = sensors()
    zero = np.zeros(9)
    still = maker.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
    begin = 1_700_000_000_000_000_000

    def stamp(t: float) -> int:
        return begin + round(1e9 * t)

    with maker.writer:
        for s in scans:
            topic = "/scan" if s.scanner == "front" else "/scan_back"
            maker.write(topic, "sensor_msgs/msg/LaserScan", stamp(s.t), maker.header(stamp(s.t), "laser"),
                        s.angle_min, -s.angle_min, s.angle_increment, 0.0, 0.04, 0.3, 20.0,
                        s.ranges.astype(np.float32), np.empty(0, np.float32))  # fmt: skip
        for r in readings:
            topic = "/imu" if r.where == "robot" else "/head/imu"
            quaternion = maker.make("geometry_msgs/msg/Quaternion", *r.q_xyzw.tolist())
            values = (maker.header(stamp(r.t), "imu"), quaternion, zero, still, zero, still, zero)
            maker.write(topic, "sensor_msgs/msg/Imu", stamp(r.t), *values)
        for k in range(30):
            for name in ("cs", "cf"):
                maker.image(f"/{name}/image", stamp(1.0 + 0.1 * k), np.full((24, 32), 9, np.uint8))
                maker.camera(f"/{name}/camera_info", stamp(1.0 + 0.1 * k))
    return maker.path

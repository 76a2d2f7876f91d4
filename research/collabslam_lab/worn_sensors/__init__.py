"""A simulated robot with laser scanners, a person who walks, and both AHRSs."""

from __future__ import annotations

from collabslam_lab.worn_sensors.floor_plan import (
    Z_UP_FROM_Y_DOWN,
    FloorPlan,
    box,
    polyline,
    table,
)
from collabslam_lab.worn_sensors.sensors import (
    AhrsModel,
    LaserModel,
    Legs,
    Motion,
    sensor_times,
    simulate_ahrs,
    simulate_scans,
)
from collabslam_lab.worn_sensors.walker import Build, Walker, camera_attitude

__all__ = [
    "Z_UP_FROM_Y_DOWN",
    "AhrsModel",
    "Build",
    "FloorPlan",
    "LaserModel",
    "Legs",
    "Motion",
    "Walker",
    "box",
    "camera_attitude",
    "polyline",
    "sensor_times",
    "simulate_ahrs",
    "simulate_scans",
    "table",
]

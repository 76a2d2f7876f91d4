"""Where the worn camera is, from a robot's laser scanners and two AHRSs (METHOD 11)."""

from __future__ import annotations

from collabslam.worn_pose.calibrate import PersonFit, calibrate_person
from collabslam.worn_pose.config import AHEAD_LEFT_UP, AhrsErrors, Person, WornPoseConfig, scanner_pose
from collabslam.worn_pose.estimator import WornPoseEstimator
from collabslam.worn_pose.readings import AhrsReading, Diagnostics, LaserScan, WornPoseEstimate
from collabslam.worn_pose.replay import ahrs_readings, estimates_at, laser_scans

__all__ = [
    "AHEAD_LEFT_UP",
    "AhrsErrors",
    "AhrsReading",
    "Diagnostics",
    "LaserScan",
    "Person",
    "PersonFit",
    "WornPoseConfig",
    "WornPoseEstimate",
    "WornPoseEstimator",
    "ahrs_readings",
    "calibrate_person",
    "estimates_at",
    "laser_scans",
    "scanner_pose",
]

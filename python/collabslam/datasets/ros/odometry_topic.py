"""Odometry of a bag: a twist topic, or the pose increments of ``nav_msgs/Odometry`` (METHOD section 23)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam.datasets.odometry import OdometryGiven, checked, increments
from collabslam.datasets.ros import messages as m
from collabslam.datasets.ros.bag import Bag
from collabslam.errors import DataError
from collabslam.types import Odometry

ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
TWIST_TYPES = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/TwistWithCovarianceStamped")


def read_odometry_topic(path: Path, given: OdometryGiven) -> Odometry:
    """Odometry of the topic ``given.source``.

    Of ``nav_msgs/Odometry`` the motion is that between its poses, and the covariance that of its twist: what
    has been integrated between two messages is exact, a twist is that of one instant.  Messages whose stamp
    repeats are left out.

    Raises
    ------
    DataError
        If the bag has no such topic, or a sample cannot be used.
    """
    where = f"{given.source} of {path}"
    with Bag(path) as bag:
        rows = list(bag.stamped(given.source, ODOMETRY_TYPE, *TWIST_TYPES))
    rows.sort(key=lambda row: row[0])
    kept = [k for k in range(len(rows)) if k == 0 or rows[k][0] > rows[k - 1][0]]
    times = np.asarray([rows[k][0] for k in kept])
    found = [rows[k][1] for k in kept]
    parts = [m.twist_of(message) for message in found]
    twists = np.asarray([twist for twist, _ in parts])
    if hasattr(found[0], "pose"):
        poses = np.asarray([m.pose_of(message.pose.pose, where) for message in found])
        if not np.isfinite(poses).all():
            raise DataError(f"A pose of {where} is not finite; record it again.")
        twists = increments(times, poses, twists[0])
    covariances = np.asarray([covariance for _, covariance in parts])
    return checked(times, twists, covariances, given.t_bc(), where, given.sd)

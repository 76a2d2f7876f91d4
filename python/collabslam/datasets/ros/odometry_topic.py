"""Odometry of a bag: a twist topic, or the pose increments of ``nav_msgs/Odometry`` (METHOD section 23)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam.datasets.odometry import OdometryGiven, checked, increments
from collabslam.datasets.ros import messages as m
from collabslam.datasets.ros.bag import TWIST_TYPES, Bag
from collabslam.errors import DataError
from collabslam.geometry import pose_inverse, se3_log
from collabslam.types import Array, Odometry

ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
_ASKED = 20
"""Instants at which tf is asked."""
_STILL = 2e-3, 2e-3
"""Metres and radians by which a mount that is fixed may seem to move."""
_REMEDY = "name the frame of the wheels and that of the images of a camera that is fixed to them"


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
        t_bc = given.t_bc() if given.frames is None else _by_tf(bag, given.frames, rows[0][0], rows[-1][0])
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
    return checked(times, twists, covariances, t_bc, where, given.sd)


def _by_tf(bag: Bag, frames: tuple[str, str], first: float, last: float) -> Array:
    """T_BC as tf says it between two stamps; raises DataError if it does not, or says that it changes."""
    tree = bag.transform_tree()
    times = np.linspace(first, last, _ASKED).tolist()
    found = [t_bc for t in times if (t_bc := tree.between(*frames, t)) is not None]
    if not found:
        raise DataError(f"tf in {bag.path} does not say where {frames[1]} is in {frames[0]}; {_REMEDY}.")
    for t_bc in found:
        off = se3_log(pose_inverse(found[0]) @ t_bc)
        if np.abs(off[:3]).max() > _STILL[0] or np.abs(off[3:]).max() > _STILL[1]:
            raise DataError(f"{frames[1]} moves in {frames[0]} by tf in {bag.path}; {_REMEDY}.")
    return found[0]

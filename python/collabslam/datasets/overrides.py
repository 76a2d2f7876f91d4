"""What a user gives beside a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from collabslam.datasets.imu.beside import GyroGiven, WornGyroGiven
from collabslam.datasets.odometry import OdometryGiven


@dataclass(frozen=True)
class Given:
    """Files and choices in place of the recording's own.

    Attributes
    ----------
    camera : Path or None
        Calibration of Cs.
    times : Path or None
        Time stamps, one a line.
    poses : Path or None
        True trajectory of Cs in TUM format.
    topics : mapping
        Topic of a bag for each role; see `collabslam.datasets.ros.bag.ROLES`.
    depth_scale : float or None
        Counts of a depth image at one metre.
    axes : mapping
        Camera axes of the ``poses`` and of both sides of the measured ``t_cf``, of `poses.AXES`.
    odometry : OdometryGiven or None
        Odometry beside the recording, or a topic of it, in place of its own.
    mask : Path or None
        An image of what is never scene in those of Cs, in place of the one that its calibration names.
    gyro : GyroGiven or None
        A gyroscope beside the recording, or a topic of it, in place of its own; or that there is none.
    worn_gyro : WornGyroGiven or None
        The same of the only worn camera's own.
    """

    camera: Path | None = None
    times: Path | None = None
    poses: Path | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    odometry: OdometryGiven | None = None
    depth_scale: float | None = None
    axes: Mapping[str, str] = field(default_factory=dict)
    gyro: GyroGiven | None = None
    mask: Path | None = None
    worn_gyro: WornGyroGiven | None = None

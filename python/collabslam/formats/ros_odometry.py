"""A trajectory as a ROS 2 bag with ``nav_msgs/Odometry`` and ``/tf``; needs the extra ``ros``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from collabslam.errors import DataError
from collabslam.extras import needs
from collabslam.formats.trajectory import position_quaternion
from collabslam.geometry import tangent_to_fixed
from collabslam.types import Array

TOPIC, TRANSFORMS = "/collabslam/odometry", "/tf"
MAP, WORLD, CAMERA = "collabslam_map", "collabslam_world", "collabslam_camera_optical"
_NANOSECONDS = 10**9


def write_odometry(
    path: Path,
    times: Array,
    poses: Array,
    covariances: Array,
    corrected: Array | None = None,
    *,
    storage: str = "sqlite3",
) -> None:
    """Write poses with covariance as a bag.

    The poses go on without a jump, as REP 105 wants it of odometry.  Where loops put them is told on ``/tf``:
    the transform from the world in which they are to the map.

    The covariance is ROS's: over (x, y, z, rotation about X, Y, Z), all along the fixed axes of W.  The
    twist is not in a result folder: it is zero, and the first number of its covariance is -1.

    Parameters
    ----------
    path : Path
        New folder.
    times : (N,) array
        Seconds; the messages carry them as their stamps.
    poses : (N, 4, 4) array
        ``T_WC``: W and C keep their optical axes (x right, y down, z forward at the start).
    covariances : (N, 6, 6) array
        Over (translation, rotation), tangent on the right.
    corrected : (N, 4, 4) array, optional
        The poses as loops correct them.
    storage : str
        One of `STORAGES`.

    Raises
    ------
    DataError
        If the folder exists, or the extra ``ros`` is not installed.
    """
    with needs("ros"):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    if path.exists():
        raise DataError(f"The folder {path} exists already; give another one for the bag.")
    store = get_typestore(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    kind = "nav_msgs/msg/Odometry"
    with Writer(path, version=Writer.VERSION_LATEST, storage_plugin=plugin) as bag:
        connection = bag.add_connection(TOPIC, kind, typestore=store)
        for t, t_wc, covariance in zip(times, poses, covariances, strict=True):
            message = odometry_message(store.types, round(float(t) * _NANOSECONDS), t_wc, covariance)
            bag.write(connection, round(float(t) * _NANOSECONDS), store.serialize_cdr(message, kind))
        if corrected is None:
            return
        kind = "tf2_msgs/msg/TFMessage"
        connection = bag.add_connection(TRANSFORMS, kind, typestore=store)
        for t, t_map_world in zip(times, corrected @ np.linalg.inv(poses), strict=True):
            message = _map_message(store.types, round(float(t) * _NANOSECONDS), t_map_world)
            bag.write(connection, round(float(t) * _NANOSECONDS), store.serialize_cdr(message, kind))


def _map_message(types: Any, stamp: int, t_map_world: Array) -> Any:
    """Where the world of the odometry is in the map, as ``tf2_msgs/TFMessage``."""
    x, y, z, qx, qy, qz, qw = position_quaternion(t_map_world)
    time = types["builtin_interfaces/msg/Time"](*divmod(stamp, _NANOSECONDS))
    transform = types["geometry_msgs/msg/Transform"](
        types["geometry_msgs/msg/Vector3"](x, y, z), types["geometry_msgs/msg/Quaternion"](qx, qy, qz, qw)
    )
    stamped = types["geometry_msgs/msg/TransformStamped"](
        types["std_msgs/msg/Header"](time, MAP), WORLD, transform
    )
    return types["tf2_msgs/msg/TFMessage"]([stamped])


def odometry_message(
    types: Any,
    stamp: int,
    t_wc: Array,
    covariance: Array,
    twist: tuple[Array, Array] | None = None,
    frames: tuple[str, str] = (WORLD, CAMERA),
) -> Any:
    """One pose as ``nav_msgs/Odometry``.

    Parameters
    ----------
    types
        The types of a rosbags store.
    stamp : int
        Nanoseconds.
    t_wc : (4, 4) array
    covariance : (6, 6) array
        Over (translation, rotation), tangent on the right.
    twist : ((6,) array, (6, 6) array), optional
        Velocity and angular velocity along the axes of the child's frame, m/s and rad/s, and their
        covariance; without it the twist is zero and the first number of its covariance -1.
    frames : (str, str)
        That of the pose, and the child's.
    """

    def make(name: str, *values: Any) -> Any:
        return types[name](*values)

    x, y, z, qx, qy, qz, qw = position_quaternion(t_wc)
    values, spread = (np.zeros(6), np.diag([-1.0, 0, 0, 0, 0, 0])) if twist is None else twist
    halves = [make("geometry_msgs/msg/Vector3", *map(float, half)) for half in (values[:3], values[3:])]
    moving = make("geometry_msgs/msg/Twist", *halves)
    spread = np.ascontiguousarray(spread, np.float64).ravel()
    return make(
        "nav_msgs/msg/Odometry",
        make(
            "std_msgs/msg/Header",
            make("builtin_interfaces/msg/Time", *divmod(stamp, _NANOSECONDS)),
            frames[0],
        ),
        frames[1],
        make(
            "geometry_msgs/msg/PoseWithCovariance",
            make(
                "geometry_msgs/msg/Pose",
                make("geometry_msgs/msg/Point", x, y, z),
                make("geometry_msgs/msg/Quaternion", qx, qy, qz, qw),
            ),
            tangent_to_fixed(t_wc, covariance).ravel(),
        ),
        make("geometry_msgs/msg/TwistWithCovariance", moving, spread),
    )

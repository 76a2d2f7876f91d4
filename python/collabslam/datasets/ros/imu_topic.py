"""A gyroscope's topic in a bag: `sensor_msgs/Imu`, and how it sits by tf."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collabslam.datasets.gate import tell
from collabslam.datasets.imu.files import Table
from collabslam.datasets.ros.bag import IMAGE_TYPES, IMU_TYPE, Bag
from collabslam.errors import DataError
from collabslam.geometry import rotation_log
from collabslam.types import Array

_ASKED = 20
"""Messages whose covariances are looked at, and instants at which tf is asked."""
_STILL = 2e-3
"""Radians by which a mount that is fixed may seem to turn."""


@dataclass(frozen=True)
class ImuTopic:
    """Samples of a topic, the name of their frame, and R_CI (3, 3) where tf tells it."""

    table: Table
    frame: str
    r_ci: Array | None


def only_topic(path: Path, worn: str | None = None) -> str | None:
    """The topic of a bag's inertial samples, if it has just one beside that of Cf's own, ``worn``; what is
    passed over is told."""
    with Bag(path) as bag:
        found = [topic.name for topic in bag.of_type(IMU_TYPE) if topic.name != worn]
    if len(found) > 1:
        tell("passed over", f"{', '.join(found)} (--gyro TOPIC takes one of them)", path)
    return found[0] if len(found) == 1 else None


def read_imu_topic(path: Path, topic: str, images: str | None, *, asked: bool) -> ImuTopic | None:
    """The samples of a topic.

    A covariance of -1 says that there is no such measurement (REP 145): then there is no gyroscope, or no
    accelerometer.

    Parameters
    ----------
    path : Path
        The bag.
    topic : str
    images : str or None
        The topic of Cs's images; the only one if None.
    asked : bool
        Whether the user named it; if not, one without angular velocity is None.

    Raises
    ------
    DataError
        If the bag has no such topic, or it has no angular velocity.
    """
    where = f"{topic} of {path}"
    with Bag(path) as bag:
        turns, forces = _measured(bag, topic)
        if not turns:
            why = "angular_velocity_covariance[0] is -1: there is no angular velocity"
            if asked:
                raise DataError(f"{where} is not a gyroscope ({why}); give another topic.")
            tell("passed over", why, where)
            return None
        samples = bag.imu(topic)
        tell("stamps", f"{len(samples.times)}, of the headers (of recording where one has none)", where)
        r_ci = _by_tf(bag, samples.frame, images, float(samples.times[0]), float(samples.times[-1]))
    accelerations = samples.acceleration if forces else None
    return ImuTopic(Table([samples.times], samples.angular_velocity, accelerations), samples.frame, r_ci)


def _measured(bag: Bag, topic: str) -> tuple[bool, bool]:
    """Whether the first messages say that they hold angular velocity, and acceleration."""
    turns = forces = True
    for _, (_, message) in zip(range(_ASKED), bag.messages(topic, IMU_TYPE), strict=False):
        turns = turns and message.angular_velocity_covariance[0] != -1.0
        forces = forces and message.linear_acceleration_covariance[0] != -1.0
    return turns, forces


def _by_tf(bag: Bag, frame: str, images: str | None, first: float, last: float) -> Array | None:
    """R_CI as tf links the sensor's frame and that of the images; None where it does not, or it changes."""
    names = [topic.name for topic in bag.of_type(*IMAGE_TYPES)]
    images = images or (names[0] if len(names) == 1 else None)
    if images is None or not frame:
        return None
    _, message = next(bag.messages(images, *IMAGE_TYPES))
    camera = str(message.header.frame_id)
    if not camera:
        return None
    if camera.lstrip("/") == frame.lstrip("/"):
        tell("axes of the gyroscope", f"those of the images ({camera})", images)
        return np.eye(3)
    tree, times = bag.transform_tree(), np.linspace(first, last, _ASKED).tolist()
    turns = [t_ci[:3, :3] for t in times if (t_ci := tree.between(camera, frame, t)) is not None]
    if not turns:
        return None
    if any(np.linalg.norm(rotation_log(turns[0].T @ turn)) > _STILL for turn in turns):
        tell("passed over", f"tf from {frame} to {camera} (it moves: the sensor is not fixed to it)", images)
        return None
    tell("axes of the gyroscope", f"by tf from {frame} to {camera}", images)
    return np.asarray(turns[0])

"""A topic of wheel odometry, message by message, as `collabslam.datasets` reads it from a bag (METHOD 23)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam.datasets.odometry import checked, increments
from collabslam.datasets.ros.messages import pose_of, twist_of
from collabslam.errors import DataError
from collabslam.live import messages
from collabslam.types import Array


@dataclass(frozen=True)
class WheelTopic:
    """Where a robot's odometry comes from.

    Attributes
    ----------
    name : str
    kind : str
        ``messages.ODOMETRY``, of which the motion between two poses counts, or ``messages.TWIST``.
    mount : (4, 4) array or (str, str)
        T_BC, maps points of Cs into the odometry's frame B, metres; or the frames of B and of Cs's images,
        which fixed links of tf join.
    sd : tuple of float or None
        Standard deviations of velocity, m/s, and angular velocity, rad/s, in place of the messages' own.
    """

    name: str
    kind: str
    mount: Array | tuple[str, str]
    sd: tuple[float, float] | None = None


class WheelSamples:
    """Samples for `collabslam.Slam.add_odometry` out of messages that come one after the other."""

    def __init__(self, topic: WheelTopic) -> None:
        self._topic = topic
        self._last: tuple[float, Array] | None = None

    def take(self, data: bytes) -> tuple[float, Array, Array] | None:
        """Stamp (seconds), twist (6,) and covariance (6, 6) of a message in CDR; None for a repeated stamp.

        Raises
        ------
        DataError
            If the message cannot be used; the next one is as if it had not come.
        """
        topic = self._topic
        message = messages.decoded(topic.kind, data)
        t = messages.stamp_of(message)
        if self._last is not None and t <= self._last[0]:
            return None
        twist, covariance = twist_of(message)
        pose = np.eye(4)
        if topic.kind == messages.ODOMETRY:
            pose = pose_of(message.pose.pose, topic.name)
            if not np.isfinite(pose).all():
                raise DataError(f"A pose of {topic.name} is not finite; send finite numbers.")
            if self._last is not None:
                since, before = self._last
                twist = increments(np.array([since, t]), np.stack([before, pose]), twist)[1]
        found = checked(np.array([t]), twist[None], covariance[None], np.eye(4), topic.name, topic.sd)
        self._last = t, pose
        return t, found.twists[0], found.covariances[0]

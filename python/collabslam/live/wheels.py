"""A topic of wheel odometry, message by message, as `collabslam.datasets` reads it from a bag (METHOD 23)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam.datasets.odometry import OdometryGiven, checked, increments
from collabslam.datasets.ros.messages import pose_of, twist_of
from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.errors import DataError
from collabslam.live import messages
from collabslam.types import Array


@dataclass(frozen=True)
class WheelTopic:
    """Where a robot's odometry comes from.

    Attributes
    ----------
    given : OdometryGiven
        The topic, and where Cs sits on the wheels: frames are joined by fixed links of tf.
    kind : str
        ``messages.ODOMETRY``, of which the motion between two poses counts, or ``messages.TWIST``.
    """

    given: OdometryGiven
    kind: str = messages.ODOMETRY

    @property
    def name(self) -> str:
        """Of the topic."""
        return self.given.source

    def t_bc(self, tree: TransformTree) -> Array | None:
        """T_BC (4, 4), maps points of Cs into the odometry's frame, metres; None until tf tells."""
        frames = self.given.frames
        return self.given.t_bc() if frames is None else tree.between(*frames, 0.0)


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
        found = checked(np.array([t]), twist[None], covariance[None], np.eye(4), topic.name, topic.given.sd)
        self._last = t, pose
        return t, found.twists[0], found.covariances[0]

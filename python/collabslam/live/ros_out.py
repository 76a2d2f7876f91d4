"""What a node of ROS 2 publishes: the base's pose and twist, links of tf, map and status."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.errors import DataError
from collabslam.live import messages, names
from collabslam.live.core import LivePose
from collabslam.live.downlink import MAP_EVERY, STATUS_EVERY, status_of, view_plans_of
from collabslam.live.propagation import Propagated
from collabslam.live.ros_frames import TF_ALL, TF_MAP, Base, RosFrames
from collabslam.live.ros_types import message_class
from collabslam.slam.engine import Slam
from collabslam.types import Array

WORN_POSE = "worn_pose"
"""Of the published topics that of a worn camera; of several persons the name follows."""
KINDS = {
    "pose": messages.POSE,
    "pose_map": messages.POSE,
    "odometry": messages.ODOMETRY,
    "odometry_propagated": messages.ODOMETRY,
    "twist": messages.TWIST,
    "map": messages.CLOUD,
}


class RosOut:
    """Publishers of one node.

    Parameters
    ----------
    node
        A ``rclpy`` node.
    out : str
        What the topics' names begin with.
    frames : RosFrames
    persons : iterable of str
        Who wears a camera; "" is a single one.
    tree : TransformTree
        What tf has told, of a robot whose wheels tell odom -> base.
    """

    def __init__(
        self, node: Any, out: str, frames: RosFrames, persons: Iterable[str], tree: TransformTree
    ) -> None:
        self.base: Base | None = None
        """Nothing but status is published without."""
        self.poses = 0
        self._frames, self._tree = frames, tree
        kinds = KINDS | {names.of_person(WORN_POSE, name): messages.POSE for name in persons}
        self._out = {
            name: node.create_publisher(message_class(kind), f"{out}/{name}", 10)
            for name, kind in kinds.items()
        }
        self._offer(node, "status", messages.STATUS, "/diagnostics")
        if frames.tf in (TF_ALL, TF_MAP):
            self._offer(node, "tf", messages.TRANSFORMS, "/tf")
        self._due = dict.fromkeys(("status", "map"), -float("inf"))

    def _offer(self, node: Any, name: str, kind: str, topic: str) -> None:
        """A topic of messages that a small ROS may lack."""
        try:
            self._out[name] = node.create_publisher(message_class(kind), topic, 10)
        except DataError as error:
            node.get_logger().warning(f"no {topic}: {error}")

    def frame(
        self, pose: LivePose, slam: Slam, facts: Mapping[str, Any], persons: Iterable[str] = ()
    ) -> None:
        """A frame is done; ``facts`` are further values for the robot's status, ``persons`` have one each."""
        step, base = pose.step, self.base
        if step.valid and base is not None:
            self._pose(pose, slam, base)
        if "status" in self._out and self._is_due("status", STATUS_EVERY):
            devices: dict[str, dict[str, float]] = {name: {} for name in persons if name}
            self._out["status"].publish(status_of(pose, facts, devices, view_plans_of(pose, slam)))
        if step.started and base is not None and self._is_due("map", MAP_EVERY):
            found, moved = slam.landmarks(), base.between(step.t_map_odom)
            points = base.points(found.points) @ moved[:3, :3].T + moved[:3, 3]
            sd = messages.point_sd(base.spread(points, found.covariance))
            self._out["map"].publish(messages.cloud(step.t, points, sd, self._frames.map))

    def waiting(self, t: float, what: str) -> None:
        """No frame has come yet, for want of that."""
        if "status" in self._out:
            entry = "NOT_STARTED", f"waits for {what}", {"waits for": what}
            self._out["status"].publish(messages.status(t, {"robot": entry}))

    def _pose(self, pose: LivePose, slam: Slam, base: Base) -> None:
        """Where the base is, how it moves, and where the worn cameras were."""
        step, frames = pose.step, self._frames
        place, spread = base.placed(step.pose, step.covariance)
        core = slam.filter
        twist = base.tangent(core.twist), base.covariance(core.pose_and_twist_covariance[6:, 6:])
        in_map, in_map_spread = base.placed(step.pose_map, step.covariance_map)
        self._out["pose"].publish(messages.pose(step.t, frames.world, place, spread))
        around = (frames.world, frames.base)
        self._out["odometry"].publish(messages.odometry(step.t, place, spread, twist, around))
        self._out["twist"].publish(messages.twist(step.t, *twist, frames.base))
        self._out["pose_map"].publish(messages.pose(step.t, frames.map, in_map, in_map_spread))
        if "tf" in self._out:
            self._tf(step.t, place, in_map)
        for name, worn in step.worn.items():
            if worn.measured:
                # Of F itself, whose axes stay optical: its tangent is what it was.
                seen, seen_spread = base.seen(worn.pose, worn.covariance)
                out = self._out[names.of_person(WORN_POSE, name)]
                out.publish(messages.pose(worn.t, frames.world, seen, seen_spread))
        self.poses += 1

    def _tf(self, t: float, place: Array, in_map: Array) -> None:
        frames = self._frames
        if frames.tf == TF_ALL:
            links = (
                (frames.map, frames.odom, in_map @ np.linalg.inv(place)),
                (frames.odom, frames.base, place),
            )
            self._out["tf"].publish(messages.transforms(t, *links))
            return
        by_wheels = self._tree.between(frames.odom, frames.base, t)
        if by_wheels is not None:
            link = (frames.map, frames.odom, in_map @ np.linalg.inv(by_wheels))
            self._out["tf"].publish(messages.transforms(t, link))

    def propagated(self, found: Propagated) -> None:
        """A pose between frames."""
        base, frames = self.base, self._frames
        if base is None:
            return
        place, spread = base.placed(found.pose, found.covariance)
        twist = base.tangent(found.twist), base.covariance(found.twist_covariance)
        message = messages.odometry(found.t, place, spread, twist, (frames.world, frames.base))
        self._out["odometry_propagated"].publish(message)

    def _is_due(self, name: str, every: float) -> bool:
        now = time.monotonic()
        if now - self._due[name] < every:
            return False
        self._due[name] = now
        return True

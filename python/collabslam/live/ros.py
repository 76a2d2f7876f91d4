"""The same as a node of ROS 2: images and poses come from topics, the pose and the map go to topics.

Messages pass as CDR, as they came: rclpy moves them, rosbags reads and writes them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.ros.sensors import ESTIMATED, WornSensors, read_sensors
from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.errors import CollabslamError, DataError, SettingsError
from collabslam.live import messages
from collabslam.live.core import LivePose
from collabslam.live.downlink import MAP_EVERY, STATUS_EVERY, status_of
from collabslam.live.pairing import Pairing
from collabslam.live.ros_types import image_kind, message_class, stamped_image, subscribe
from collabslam.live.sensed import SensedPoses, sensor_topics
from collabslam.live.slam import LiveSlam
from collabslam.live.transforms import WaitingStamps
from collabslam.live.wheels import WheelSamples, WheelTopic
from collabslam.settings.table import Settings
from collabslam.slam.engine import Slam
from collabslam.types import Array

NAME = "collabslam"
SESSION = "ros/1"
"""Of the one worn camera that the topics tell of."""
TF, TF_STATIC = "/tf", "/tf_static"
Take = tuple[str | None, str, Callable[[bytes], None]]
"""A topic, its type, and who takes its messages."""


@dataclass(frozen=True)
class RosTopics:
    """Names of topics; images are CompressedImage where the name ends in ``compressed``, Image elsewhere.

    Attributes
    ----------
    cs, cs_info : str
        Images of Cs and their CameraInfo.
    cf, cf_info, t_cf : str or None
        The same of Cf, and T_CF as PoseWithCovarianceStamped with the stamps of Cf's images; or `TF`: then it
        is between the frames that both cameras' images name; or ``sensors:FILE``: then it is estimated from
        the laser scans and AHRSs whose topics and mounts the file tells.
    t_cf_sd : tuple of float, optional
        Standard deviations of T_CF by tf, which has none: metres of each coordinate, degrees about each axis.
    wheels : WheelTopic or None
        Odometry of the robot.
    out : str
        What the published topics' names begin with.
    """

    cs: str
    cs_info: str
    cf: str | None = None
    cf_info: str | None = None
    t_cf: str | None = None
    t_cf_sd: tuple[float, float] | None = None
    wheels: WheelTopic | None = None
    out: str = "/collabslam"


class RosNode:
    """A node that runs the filter.

    Parameters
    ----------
    node
        A ``rclpy`` node.
    topics : RosTopics
    settings : Settings
    mode : str or None
        The settings' if None.
    start : str
        As of `collabslam.Slam`.

    Raises
    ------
    DataError
        If message types are not installed, or the sensors file is not usable.
    SettingsError
        If T_CF is to come from tf and its standard deviations are missing.
    """

    def __init__(
        self,
        node: Any,
        topics: RosTopics,
        settings: Settings,
        *,
        mode: str | None = None,
        start: str = "worn",
    ) -> None:
        self.poses = 0
        self._settings, self._mode, self._start = settings, mode, start
        self._cameras: dict[str, Camera] = {}
        self._wanted = {"cs"} | ({"cf"} if topics.cf else set())
        self._pairing = Pairing()
        self._live: LiveSlam | None = None
        self._refused = 0
        self._due = dict.fromkeys(("status", "map"), -float("inf"))
        self._frame = ""
        self._tf: WaitingStamps | None = None
        self._sensed: SensedPoses | None = None
        self._wheels = topics.wheels
        self._fixed = TransformTree()
        takes: list[Take] = [
            (topics.cs_info, messages.CAMERA_INFO, lambda data: self._calibration("cs", data)),
            (topics.cf_info, messages.CAMERA_INFO, lambda data: self._calibration("cf", data)),
            (topics.cs, image_kind(topics.cs), lambda data: self._robot(topics.cs, data)),
            (topics.cf, image_kind(topics.cf or ""), lambda data: self._worn(str(topics.cf), data)),
        ]
        if topics.t_cf == TF:
            if topics.t_cf_sd is None:
                raise SettingsError(
                    "tf tells no uncertainty; give that of T_CF with --t-cf-sd METRES,DEGREES, as measured."
                )
            self._tf = WaitingStamps(topics.t_cf_sd)
            takes += [
                (TF, messages.TRANSFORMS, lambda data: self._transforms(data, static=False)),
                (TF_STATIC, messages.TRANSFORMS, lambda data: self._transforms(data, static=True)),
            ]
            self._fixed = self._tf.tree
        elif (topics.t_cf or "").startswith(ESTIMATED):
            takes += self._sensors(read_sensors(Path(str(topics.t_cf).removeprefix(ESTIMATED))))
        else:
            takes.append((topics.t_cf, messages.POSE, lambda data: self._pose(data)))
        if topics.wheels is not None:
            takes += self._driven(topics.wheels, hears_tf=topics.t_cf == TF)
        self._kept = [
            subscribe(node, topic, kind, take, self._refuse, latched=topic == TF_STATIC)
            for topic, kind, take in takes
            if topic is not None
        ]
        self._out = {
            name: node.create_publisher(message_class(kind), f"{topics.out}/{name}", 10)
            for name, kind in (
                ("pose", messages.POSE),
                ("pose_map", messages.POSE),
                ("odometry", messages.ODOMETRY),
                ("map", messages.CLOUD),
            )
        }
        for name, kind, topic in (
            ("status", messages.STATUS, "/diagnostics"),
            ("tf", messages.TRANSFORMS, "/tf"),
        ):
            self._offer(node, name, kind, topic)

    def _offer(self, node: Any, name: str, kind: str, topic: str) -> None:
        """A topic of messages that a small ROS may lack."""
        try:
            self._out[name] = node.create_publisher(message_class(kind), topic, 10)
        except DataError as error:
            node.get_logger().warning(f"no {topic}: {error}")

    def close(self) -> None:
        """Ends the filter; raises whatever ended it before."""
        if self._live is not None:
            self._live.close()

    def _calibration(self, which: str, data: bytes) -> None:
        if which in self._cameras or self._live is not None:
            return
        self._cameras[which] = messages.camera_from(data, f"CameraInfo of {which}")
        self._begin()

    def _begin(self) -> None:
        """Makes the filter once the cameras, and where they sit on the wheels, are known."""
        t_bc = self._mount()
        if self._live is not None or not self._wanted <= self._cameras.keys() or t_bc is None:
            return
        cameras = self._cameras["cs"], self._cameras.get("cf")
        slam = Slam(*cameras, settings=self._settings, mode=self._mode, start=self._start, t_bc=t_bc)
        self._live = LiveSlam(slam, on_pose=self._publish, same_clock=True)

    def _mount(self) -> Array | None:
        """T_BC; None as long as tf has not told it."""
        return np.eye(4) if self._wheels is None else self._wheels.t_bc(self._fixed)

    def _driven(self, wheels: WheelTopic, *, hears_tf: bool) -> list[Take]:
        """What is to be heard of the wheels."""
        samples = WheelSamples(wheels)

        def sample(data: bytes) -> None:
            found = samples.take(data)
            if found is not None and self._live is not None:
                self._live.push_odometry(*found)

        takes: list[Take] = [(wheels.name, wheels.kind, sample)]
        if wheels.given.frames is not None and not hears_tf:
            takes.append((TF_STATIC, messages.TRANSFORMS, self._links))
        return takes

    def _links(self, data: bytes) -> None:
        """Fixed links of tf."""
        self._fixed.take(messages.decoded(messages.TRANSFORMS, data), static=True)
        self._begin()

    def _robot(self, topic: str, data: bytes) -> None:
        t, image, self._frame = stamped_image(topic, data)
        if self._live is not None:
            self._live.push_robot(t, image)

    def _worn(self, topic: str, data: bytes) -> None:
        stamp, image, frame = stamped_image(topic, data)
        self._push(self._pairing.image(SESSION, stamp, image))
        if self._tf is not None:
            self._tf.add(stamp, frame)
        if self._sensed is not None:
            self._sensed.add(stamp, stamp)
        self._measured()

    def _transforms(self, data: bytes, *, static: bool) -> None:
        assert self._tf is not None
        self._tf.tree.take(messages.decoded(messages.TRANSFORMS, data), static=static)
        self._begin()
        self._measured()

    def _sensors(self, sensors: WornSensors) -> list[Take]:
        """What is to be heard of the sensors."""
        self._sensed = SensedPoses(sensors.config)

        def taken(take: Callable[[bytes], None], data: bytes) -> None:
            take(data)
            self._measured()

        return [
            (topic, kind, partial(taken, take)) for topic, kind, take in sensor_topics(sensors, self._sensed)
        ]

    def _measured(self) -> None:
        """Views of the images whose T_CF is known by now."""
        for found in [] if self._tf is None else self._tf.known(self._frame):
            self._push(self._pairing.pose(*found))
        for known in [] if self._sensed is None else self._sensed.known():
            self._push(self._pairing.pose(*known))

    def _pose(self, data: bytes) -> None:
        self._push(self._pairing.pose(*messages.pose_from(data, "T_CF")))

    def _push(self, view: Any) -> None:
        if view is not None and self._live is not None:
            self._live.push(view)

    def _refuse(self, error: CollabslamError) -> None:
        self._refused += 1

    def _publish(self, pose: LivePose) -> None:
        step = pose.step
        if step.valid:
            self._out["pose"].publish(messages.robot_pose(step.t, step.pose, step.covariance))
            self._out["odometry"].publish(messages.odometry(step.t, step.pose, step.covariance))
            in_map = messages.pose_in_map(step.t, step.pose_map, step.covariance_map)
            self._out["pose_map"].publish(in_map)
            if "tf" in self._out:
                self._out["tf"].publish(messages.transforms(step.t, step.t_map_odom, step.pose))
            self.poses += 1
        live = self._live
        if live is None:
            return
        if "status" in self._out and self._is_due("status", STATUS_EVERY):
            dropped = {f"dropped {k}": v for k, v in live.dropped.items()}
            dropped |= {"refused": self._refused + sum(live.refused.values())}
            if self._sensed is not None:
                dropped |= {f"no pose: {k}": v for k, v in self._sensed.reasons.items()}
            self._out["status"].publish(status_of(pose, dropped, {}))
        if step.started and self._is_due("map", MAP_EVERY):
            self._out["map"].publish(messages.cloud(step.t, live.slam.landmarks().points))

    def _is_due(self, name: str, every: float) -> bool:
        now = time.monotonic()
        if now - self._due[name] < every:
            return False
        self._due[name] = now
        return True

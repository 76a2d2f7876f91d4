"""The same as a node of ROS 2: images and poses come from topics, the pose and the map go to topics.

Messages pass as CDR, as they came: rclpy moves them, rosbags reads and writes them.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.errors import CollabslamError, DataError
from collabslam.live import messages, names
from collabslam.live.core import LivePose
from collabslam.live.downlink import MAP_EVERY, STATUS_EVERY, status_of, view_plans_of, worn_poses
from collabslam.live.gyro_topic import GyroTopic, sample_of
from collabslam.live.ros_types import image_kind, message_class, stamped_image, subscribe
from collabslam.live.ros_worn import TF, RosWorn, Take, WornTopics, check_own
from collabslam.live.slam import LiveSlam
from collabslam.live.views import LiveView
from collabslam.live.wheels import WheelSamples, WheelTopic
from collabslam.settings.table import Settings
from collabslam.slam.engine import Slam
from collabslam.types import Array, Imu

NAME = "collabslam"
TF_STATIC = "/tf_static"
WORN_POSE = "worn_pose"
"""Of the published topics that of a worn camera; of several persons the name follows."""


@dataclass(frozen=True)
class RosTopics:
    """Names of topics; images are CompressedImage where the name ends in ``compressed``, Image elsewhere.

    Attributes
    ----------
    cs, cs_info : str
        Images of Cs and their CameraInfo.
    worn : mapping
        Those of each Cf, by the name of whoever wears it; "" is that of a single one.
    wheels : WheelTopic or None
        Odometry of the robot.
    gyro : GyroTopic or None
        Its gyroscope.
    out : str
        What the published topics' names begin with.
    """

    cs: str
    cs_info: str
    worn: Mapping[str, WornTopics] = field(default_factory=dict)
    wheels: WheelTopic | None = None
    gyro: GyroTopic | None = None
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
        If T_CF is to come from tf and its standard deviations are missing, or two persons share a topic.
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
        self._topics, self._settings, self._mode, self._start = topics, settings, mode, start
        self._camera: Camera | None = None
        self._worn_cameras: dict[str, Camera] = {}
        self._live: LiveSlam | None = None
        self._refused = 0
        self._due = dict.fromkeys(("status", "map"), -float("inf"))
        self._frame = self._info_frame = self._gyro_frame = ""
        self._tree = TransformTree()
        self._wheels = topics.wheels
        self._worn = {name: RosWorn(name, of, self._tree, self._push) for name, of in topics.worn.items()}
        check_own(self._worn)
        takes: list[Take] = [
            (topics.cs_info, messages.CAMERA_INFO, self._calibration),
            (topics.cs, image_kind(topics.cs), partial(self._robot, topics.cs)),
            *self._of_persons(topics.worn),
            *([] if topics.wheels is None else [self._of_wheels(topics.wheels)]),
            *([] if topics.gyro is None else [(topics.gyro.name, messages.IMU, self._rate)]),
            *self._of_tf(topics),
        ]
        self._kept = [
            subscribe(node, topic, kind, take, self._refuse, latched=topic == TF_STATIC)
            for topic, kind, take in takes
        ]
        self._out = {
            name: node.create_publisher(message_class(kind), f"{topics.out}/{name}", 10)
            for name, kind in (
                ("pose", messages.POSE),
                ("pose_map", messages.POSE),
                ("odometry", messages.ODOMETRY),
                ("map", messages.CLOUD),
                *((names.of_person(WORN_POSE, name), messages.POSE) for name in topics.worn),
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

    def _calibration(self, data: bytes) -> None:
        if self._camera is None:
            self._camera = messages.camera_from(data, "CameraInfo of Cs", self._topics.cs)
            self._info_frame = str(messages.decoded(messages.CAMERA_INFO, data).header.frame_id)
            self._begin()

    def _worn_calibration(self, name: str, data: bytes) -> None:
        if name not in self._worn_cameras:
            where, images = f"CameraInfo of Cf {name}".rstrip(), self._topics.worn[name].images
            self._worn_cameras[name] = messages.camera_from(data, where, images)
            self._begin()

    def _begin(self) -> None:
        """Makes the filter once the cameras, and how Cs sits on the wheels and the gyroscope, are known."""
        t_bc, imu = self._mount(), self._sensor()
        missing = self._worn.keys() - self._worn_cameras.keys()
        if self._live is not None or self._camera is None or missing or t_bc is None:
            return
        if self._topics.gyro is not None and imu is None:
            return
        worn = {name: self._worn_cameras[name] for name in self._worn}
        slam = Slam(
            self._camera,
            worn,
            settings=self._settings,
            mode=self._mode,
            start=self._start,
            t_bc=t_bc,
            imu=imu,
        )
        self._live = LiveSlam(slam, on_pose=self._publish, same_clock=True)

    def _mount(self) -> Array | None:
        """T_BC; None as long as tf has not told it."""
        return np.eye(4) if self._wheels is None else self._wheels.t_bc(self._tree)

    def _sensor(self) -> Imu | None:
        """The gyroscope; None without one, and as long as tf has not told how it sits."""
        gyro = self._topics.gyro
        return None if gyro is None else gyro.sensor(self._tree, self._info_frame, self._gyro_frame)

    def _rate(self, data: bytes) -> None:
        frame, t, rate = sample_of(data)
        if self._live is not None:
            self._live.push_gyro(t, rate)
        elif frame != self._gyro_frame:
            self._gyro_frame = frame
            self._begin()

    def _of_persons(self, topics: Mapping[str, WornTopics]) -> Iterator[Take]:
        """What is to be heard of the worn cameras."""
        for name, worn in self._worn.items():
            yield topics[name].info, messages.CAMERA_INFO, partial(self._worn_calibration, name)
            for topic, kind, take in worn.takes:
                yield topic, kind, partial(self._measure, worn, take)

    def _of_tf(self, topics: RosTopics) -> Iterator[Take]:
        """What is to be heard of tf: all, if it tells a T_CF; fixed links, if it places Cs or a gyroscope."""
        moving = any(of.t_cf == TF for of in topics.worn.values())
        if moving:
            yield TF, messages.TRANSFORMS, partial(self._transforms, static=False)
        wheels, gyro = topics.wheels, topics.gyro
        fixed = wheels is not None and wheels.given.frames is not None
        if moving or fixed or (gyro is not None and gyro.asks_tf):
            yield TF_STATIC, messages.TRANSFORMS, partial(self._transforms, static=True)

    def _of_wheels(self, wheels: WheelTopic) -> Take:
        """What is to be heard of the wheels."""
        samples = WheelSamples(wheels)

        def sample(data: bytes) -> None:
            found = samples.take(data)
            if found is not None and self._live is not None:
                self._live.push_odometry(*found)

        return wheels.name, wheels.kind, sample

    def _robot(self, topic: str, data: bytes) -> None:
        t, image, self._frame = stamped_image(topic, data)
        if self._live is not None:
            self._live.push_robot(t, image)

    def _measure(self, worn: RosWorn, take: Callable[[bytes], None], data: bytes) -> None:
        """A message of a worn camera, or of what tells its T_CF."""
        take(data)
        worn.measured(self._frame)

    def _transforms(self, data: bytes, *, static: bool) -> None:
        self._tree.take(messages.decoded(messages.TRANSFORMS, data), static=static)
        self._begin()
        for worn in self._worn.values():
            worn.measured(self._frame)

    def _push(self, view: LiveView) -> None:
        if self._live is not None:
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
        for name, place in worn_poses(pose).items():
            self._out[names.of_person(WORN_POSE, name)].publish(place)
        live = self._live
        if live is None:
            return
        if "status" in self._out and self._is_due("status", STATUS_EVERY):
            dropped = {f"dropped {k}": v for k, v in live.dropped.items()}
            dropped |= {"refused": self._refused + sum(live.refused.values())}
            unposed = sum((Counter(worn.unposed) for worn in self._worn.values()), Counter())
            dropped |= {f"no pose: {k}": v for k, v in unposed.items()}
            persons: dict[str, dict[str, float]] = {name: {} for name in self._worn if name}
            self._out["status"].publish(status_of(pose, dropped, persons, view_plans_of(pose, live.slam)))
        if step.started and self._is_due("map", MAP_EVERY):
            self._out["map"].publish(messages.cloud(step.t, live.slam.landmarks().points))

    def _is_due(self, name: str, every: float) -> bool:
        now = time.monotonic()
        if now - self._due[name] < every:
            return False
        self._due[name] = now
        return True

"""The same as a node of ROS 2: images and poses come from topics, the pose and the map go to topics.

Messages pass as CDR, as they came: rclpy moves them, rosbags reads and writes them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import TimeoutError as TooLate
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.errors import CollabslamError, InputError
from collabslam.level import Level
from collabslam.live import messages
from collabslam.live.core import LivePose
from collabslam.live.gyro_topic import GyroTopic, sample_of
from collabslam.live.propagation import Motion, Propagator
from collabslam.live.ros_frames import TF_MAP, Base, RosFrames
from collabslam.live.ros_out import RosOut
from collabslam.live.ros_services import offer_services
from collabslam.live.ros_types import ImageTopic, subscribe
from collabslam.live.ros_worn import TF, RosWorn, Take, WornTopics, check_own
from collabslam.live.slam import LiveSlam
from collabslam.live.views import LiveView
from collabslam.live.wheels import WheelSamples, WheelTopic
from collabslam.results import GyroEstimate
from collabslam.settings.table import Settings
from collabslam.slam.engine import Slam
from collabslam.slam.map.saved_map import SavedMap
from collabslam.types import Array, Imu

NAME = "collabslam"
TF_STATIC = "/tf_static"
PATIENCE = 5.0
"""Seconds that a service waits for the filter's thread."""
LOOK = 3.0
"""Seconds after which it is looked again at what a node waits for."""


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
    frames : RosFrames
    latency : float
        Seconds by which images of Cs are stamped after they were taken.
    propagate : float
        Poses a second between frames, by the gyroscope; 0 for none.
    is_level : bool
        Whether the world is to be level.  Poses are published once it is known which way is down, and it
        stays as it was known first: the world never turns.
    told : Level or None
        Which way is down where Cs begins; None if the accelerometer is to tell it.
    """

    cs: str
    cs_info: str
    worn: Mapping[str, WornTopics] = field(default_factory=dict)
    wheels: WheelTopic | None = None
    gyro: GyroTopic | None = None
    out: str = "/collabslam"
    frames: RosFrames = field(default_factory=RosFrames)
    latency: float = 0.0
    propagate: float = 100.0
    is_level: bool = False
    told: Level | None = None


@dataclass(frozen=True)
class MapFiles:
    """``start``: the map to start in; ``save``: where a map is saved; None where there is none."""

    start: Path | None = None
    save: Path | None = None


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
    maps : callable, optional
        Says which files of maps are asked for now; a map to start in at the first call is started in at once.

    Raises
    ------
    DataError
        If message types are not installed, or the sensors file or the map is not usable.
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
        maps: Callable[[], MapFiles] = MapFiles,
    ) -> None:
        self._topics, self._settings, self._mode, self._start = topics, settings, mode, start
        self._maps = maps
        first = maps().start
        self._map = None if first is None else SavedMap.load(first)
        self._camera: Camera | None = None
        self._worn_cameras: dict[str, Camera] = {}
        self._live: LiveSlam | None = None
        self._propagator: Propagator | None = None
        self._t_bc: Array | None = None
        self._refused = self._frames = 0
        self._waits = ""
        self._log, self._clock = node.get_logger(), node.get_clock()
        self._frame = self._info_frame = self._gyro_frame = ""
        self._tree = TransformTree()
        self._wheels = topics.wheels
        self._worn = {name: RosWorn(name, of, self._tree, self._push) for name, of in topics.worn.items()}
        check_own(self._worn)
        self._images = images = ImageTopic(topics.cs)
        takes: list[Take] = [
            (topics.cs_info, messages.CAMERA_INFO, self._calibration),
            (images.name, images.kind, partial(self._robot, images)),
            *self._of_persons(topics.worn),
            *([] if topics.wheels is None else [self._of_wheels(topics.wheels)]),
            *([] if topics.gyro is None else [(topics.gyro.name, messages.IMU, self._rate)]),
            *self._of_tf(topics),
        ]
        self._kept = [
            subscribe(node, topic, kind, take, self._refuse, latched=topic == TF_STATIC)
            for topic, kind, take in takes
        ]
        self._out = RosOut(node, topics.out, topics.frames, topics.worn, self._tree)
        self._kept += offer_services(
            node,
            topics.out,
            {"save_map": self._save_map, "start_in_map": self._start_in_map, "reset": self._reset},
        )
        self._kept.append(node.create_timer(LOOK, self._tell_wait))

    def close(self) -> None:
        """Ends the filter; raises whatever ended it before."""
        if self._live is not None:
            self._live.close()

    def waits_for(self) -> str:
        """What has to come before there is a pose; "" once one was published."""
        topics = self._topics
        if self._out.poses:
            return ""
        infos = [] if self._camera is not None else [topics.cs_info]
        infos += [topics.worn[name].info for name in self._worn if name not in self._worn_cameras]
        if infos:
            return f"CameraInfo on {', '.join(infos)}"
        if self._live is None:
            return "links of tf or messages of a gyroscope, which tell how what it hears sits on the robot"
        if not self._frames:
            return f"images on {topics.cs}"
        if self._out.base is None:
            return "what tells which way is down"
        if self._worn and self._map is None and self._start == "worn":
            shown = ", ".join(f"{of.images} with {of.t_cf}" for of in topics.worn.values())
            return f"a view of {shown} that shows what {topics.cs} does"
        return "a start"

    def _tell_wait(self) -> None:
        """Says it, in the log once, and in the status as long as no frame's is there."""
        waits = self.waits_for()
        if waits and not self._frames:
            self._out.waiting(1e-9 * self._clock.now().nanoseconds, waits)
        if waits != self._waits:
            self._waits = waits
            if waits:
                self._log.warning(f"waits for {waits}")
            else:
                self._log.info(f"publishes poses on {self._topics.out}/odometry")

    def _calibration(self, data: bytes) -> None:
        if self._camera is None:
            self._camera = messages.camera_from(data, "CameraInfo of Cs", self._topics.cs)
            self._images.camera = self._camera
            self._info_frame = str(messages.decoded(messages.CAMERA_INFO, data).header.frame_id)
            self._begin()

    def _worn_calibration(self, name: str, data: bytes) -> None:
        if name not in self._worn_cameras:
            where, images = f"CameraInfo of Cf {name}".rstrip(), self._topics.worn[name].images
            self._worn_cameras[name] = messages.camera_from(data, where, images)
            self._worn[name].images.camera = self._worn_cameras[name]
            self._begin()

    def _begin(self) -> None:
        """Makes the filter once the cameras, and how Cs sits on the wheels and the gyroscope, are known."""
        t_bc, imu = self._mount(), self._sensor()
        missing = self._worn.keys() - self._worn_cameras.keys()
        if self._live is not None or self._camera is None or missing or t_bc is None:
            return
        base = self._topics.frames.t_bc(self._tree, None if self._wheels is None else t_bc)
        if base is None or (self._topics.gyro is not None and imu is None):
            return
        self._t_bc = base
        known = self._topics.told is not None or not self._topics.is_level
        self._out.base = Base(base, self._topics.told) if known else None
        worn = {name: self._worn_cameras[name] for name in self._worn}
        slam = Slam(
            self._camera,
            worn,
            settings=self._settings,
            mode=self._mode,
            start=self._start if self._map is None else "map",
            map=self._map,
            t_bc=t_bc,
            imu=imu,
        )
        if imu is not None and self._topics.propagate > 0.0:
            sizes = self._settings.replace(imu.sizes).filter
            self._propagator = Propagator(
                imu.r_ci, sizes.imu.gyro_noise, sizes.process.acceleration_density, self._topics.propagate
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
        frame, sample = sample_of(data)
        if self._live is not None:
            self._live.push(sample)
            found = None if self._propagator is None else self._propagator.add(sample.t, sample.rate)
            if found is not None:
                self._out.propagated(found)
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
        """What is to be heard of tf: all, if it tells a T_CF or odom -> base; else fixed links, if asked."""
        moving = any(of.t_cf == TF for of in topics.worn.values()) or topics.frames.tf == TF_MAP
        if moving:
            yield TF, messages.TRANSFORMS, partial(self._transforms, static=False)
        wheels, gyro = topics.wheels, topics.gyro
        fixed = wheels is not None and wheels.given.frames is not None
        gyros = [gyro, *(of.gyro for of in topics.worn.values())]
        if moving or fixed or topics.frames.asks_tf or any(of is not None and of.asks_tf for of in gyros):
            yield TF_STATIC, messages.TRANSFORMS, partial(self._transforms, static=True)

    def _of_wheels(self, wheels: WheelTopic) -> Take:
        """What is to be heard of the wheels."""
        samples = WheelSamples(wheels)

        def sample(data: bytes) -> None:
            found = samples.take(data)
            if found is not None and self._live is not None:
                self._live.push_odometry(*found)

        return wheels.name, wheels.kind, sample

    def _robot(self, images: ImageTopic, data: bytes) -> None:
        t, image, self._frame = images.stamped(data)
        if self._live is not None:
            self._live.push_robot(t - self._topics.latency, image)

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
        live, step = self._live, pose.step
        if live is None:
            return
        self._frames += 1
        facts: dict[str, Any] = {f"dropped {k}": v for k, v in live.dropped.items()}
        facts |= {"refused": self._refused + sum(live.refused.values())}
        unposed = sum((Counter(worn.unposed) for worn in self._worn.values()), Counter())
        facts |= {f"no pose: {k}": v for k, v in unposed.items()}
        facts |= {
            f"gyroscope of Cf {name}".rstrip(): worn.gyroscope
            for name, worn in self._worn.items()
            if worn.gyroscope is not None
        }
        if self._out.base is None and self._t_bc is not None and step.level is not None:
            self._out.base = Base(self._t_bc, step.level)
        if self._out.base is None:
            facts |= {"waits for": "which way is down; no pose is published before"}
        if step.gyro is not None and step.gyro.followed:
            facts |= self._latency(step.gyro)
        self._out.frame(pose, live.slam, facts, self._worn)
        if self._propagator is not None:
            core, gyro = live.slam.filter, step.gyro
            known = step.valid and gyro is not None and gyro.followed
            self._propagator.motion = (
                Motion(
                    step.t,
                    step.pose,
                    core.twist,
                    core.pose_and_twist_covariance,
                    gyro.bias,
                    gyro.bias_sd,
                    gyro.time_offset,
                )
                if known and gyro is not None
                else None
            )

    def _latency(self, gyro: GyroEstimate) -> dict[str, str]:
        """By how much images come stamped too late: as it was told, and what the gyroscope's clock adds."""
        found = self._topics.latency + gyro.time_offset
        return {"latency_s": f"{found:.4f}", "latency_sd_s": f"{gyro.time_offset_sd:.4f}"}

    def _save_map(self) -> str:
        live, place = self._running(), self._maps().save
        if place is None:
            raise InputError("No file was named for the map; say where it is to be saved (save_map).")
        try:
            live.ask(Slam.saved_map).result(PATIENCE).save(place)
        except TooLate:
            raise InputError("The filter is busy and did not give its map; ask again.") from None
        return f"the map is in {place}"

    def _start_in_map(self) -> str:
        place = self._maps().start
        if place is None:
            raise InputError("No map was named to start in; name its file (map).")
        self._again(SavedMap.load(place))
        return f"it starts in {place}"

    def _reset(self) -> str:
        self._again(None)
        return "it begins anew"

    def _again(self, found: SavedMap | None) -> None:
        """Another filter in place of this one, with the same cameras."""
        live, self._live, self._propagator = self._running(), None, None
        with suppress(CollabslamError):  # what has ended it is the reason to begin anew
            live.close(flush=False)
        self._map = found
        self._begin()

    def _running(self) -> LiveSlam:
        if self._live is None:
            raise InputError("The filter has not begun: CameraInfo, or a link of tf, has not come yet.")
        return self._live

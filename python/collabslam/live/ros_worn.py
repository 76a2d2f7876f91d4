"""A worn camera by topics of ROS 2: its images, and what tells its T_CF."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from collabslam.datasets.ros.sensors import ESTIMATED, read_sensors
from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.errors import SettingsError
from collabslam.live import messages
from collabslam.live.gyro_topic import GyroTopic, sample_of
from collabslam.live.pairing import Pairing
from collabslam.live.ros_types import ImageTopic
from collabslam.live.sensed import SensedPoses, sensor_topics
from collabslam.live.transforms import WaitingStamps
from collabslam.live.views import LiveView
from collabslam.types import Imu

TF = "/tf"
Take = tuple[str, str, Callable[[bytes], None]]
"""A topic, its type, and who takes its messages in CDR."""


@dataclass(frozen=True)
class WornTopics:
    """Names of the topics of a worn camera.

    Attributes
    ----------
    images, info : str
        Images of Cf and their CameraInfo.
    t_cf : str
        T_CF as PoseWithCovarianceStamped with the stamps of Cf's images; or `TF`: then it is between the
        frames that both cameras' images name; or ``sensors:FILE``: then it is estimated from the laser scans
        and AHRSs whose topics and mounts the file tells.
    t_cf_sd : tuple of float, optional
        Standard deviations of T_CF by tf, which has none: metres of each coordinate, degrees about each axis.
    gyro : GyroTopic, optional
        Cf's own gyroscope.
    """

    images: str
    info: str
    t_cf: str
    t_cf_sd: tuple[float, float] | None = None
    gyro: GyroTopic | None = None


class RosWorn:
    """Makes views of a worn camera's messages.

    Parameters
    ----------
    name : str
        Of whoever wears it; "" for the only one.
    topics : WornTopics
    tree : TransformTree
        What tf has told, if T_CF comes from it, or how the gyroscope sits.
    push : callable
        Is given each view.

    Attributes
    ----------
    images : ImageTopic
        Where its images come.
    takes : list of `Take`
        What is to be heard besides CameraInfo and tf.
    own : list of str
        Topics that tell of this camera alone.
    Raises
    ------
    DataError
        If the sensors file is not usable.
    SettingsError
        If T_CF is to come from tf and its standard deviations are missing, or not positive.
    """

    def __init__(
        self, name: str, topics: WornTopics, tree: TransformTree, push: Callable[[LiveView], None]
    ) -> None:
        self._topics, self._tree, self._push = topics, tree, push
        self._session = f"{name or 'ros'}/1"
        self._pairing = Pairing()
        self._tf: WaitingStamps | None = None
        self._sensed: SensedPoses | None = None
        self._imu: Imu | None = None
        self._frame = self._gyro_frame = ""
        self._with_rate = 0
        self.images = ImageTopic(topics.images)
        self.takes: list[Take] = [(self.images.name, self.images.kind, self._image)]
        self.own = [topics.images]
        if topics.t_cf == TF:
            if topics.t_cf_sd is None:
                raise SettingsError(
                    "tf tells no uncertainty; give that of T_CF with --t-cf-sd METRES,DEGREES, as measured "
                    "(of several persons NAME=METRES,DEGREES)."
                )
            self._tf = WaitingStamps(topics.t_cf_sd, tree)
        elif topics.t_cf.startswith(ESTIMATED):
            sensors = read_sensors(Path(topics.t_cf.removeprefix(ESTIMATED)))
            self._sensed = SensedPoses(sensors.config)
            self.takes += sensor_topics(sensors, self._sensed)
            self.own.append(sensors.ahrs["worn"])
        else:
            self.takes.append((topics.t_cf, messages.POSE, self._pose))
            self.own.append(topics.t_cf)
        if topics.gyro is not None:
            self.takes.append((topics.gyro.name, messages.IMU, partial(self._rate, topics.gyro)))
            self.own.append(topics.gyro.name)

    @property
    def unposed(self) -> Mapping[str, int]:
        """Why the sensors did not tell T_CF, and how often."""
        return {} if self._sensed is None else self._sensed.reasons

    @property
    def gyroscope(self) -> str | None:
        """Of how many views it told how Cf turned, or what it waits for meanwhile; None without one."""
        if self._topics.gyro is None:
            return None
        if not self._gyro_frame:
            return f"waits for samples on {self._topics.gyro.name}"
        if self._imu is None:
            return f"waits for a link of tf from {self._gyro_frame!r} to its camera; or give --worn-imu"
        return f"views whose turn it told: {self._with_rate}"

    def measured(self, robot_frame: str) -> None:
        """Views of the images whose T_CF is known by now; ``robot_frame`` is that of Cs in tf."""
        for found in [] if self._tf is None else self._tf.known(robot_frame):
            self._give(self._pairing.pose(*found))
        for known in [] if self._sensed is None else self._sensed.known():
            self._give(self._pairing.pose(*known))

    def _image(self, data: bytes) -> None:
        stamp, image, self._frame = self.images.stamped(data)
        self._give(self._pairing.image(self._session, stamp, image))
        if self._tf is not None:
            self._tf.add(stamp, self._frame)
        if self._sensed is not None:
            self._sensed.add(stamp, stamp)

    def _pose(self, data: bytes) -> None:
        self._give(self._pairing.pose(*messages.pose_from(data, f"T_CF on {self._topics.t_cf}")))

    def _rate(self, gyro: GyroTopic, data: bytes) -> None:
        """A sample, along the axes of Cf and by the clock of its images once it is known how it sits."""
        self._gyro_frame, sample = sample_of(data)
        if self._imu is None:
            self._imu = gyro.sensor(self._tree, self._frame, self._gyro_frame)
        if self._imu is not None:
            t, rate = sample.t + self._imu.time_offset, self._imu.r_ci @ sample.rate
            self._pairing.rates.add(self._session, t, rate)

    def _give(self, view: LiveView | None) -> None:
        if view is not None:
            self._with_rate += view.rate is not None
            self._push(view)


def check_own(worn: Mapping[str, RosWorn]) -> None:
    """Raises SettingsError if two persons share a topic that tells of one camera alone."""
    owners: dict[str, str] = {}
    for name, of in worn.items():
        for topic in of.own:
            if owners.setdefault(topic, name) != name:
                raise SettingsError(
                    f"The topic {topic} was given for {owners[topic]} and for {name}; give each person's own."
                )

"""All that reached the filter as a ROS 2 bag (MCAP), in the order in which it did; and back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.ros.bag import Bag
from collabslam.datasets.ros.messages import image_of, pose_and_covariance_of, twist_of
from collabslam.errors import DataError, InputError
from collabslam.extras import needs
from collabslam.live import messages
from collabslam.live.arguments import checked
from collabslam.live.core import ClockReading, Event, GyroSample, OdometrySample, RobotFrame
from collabslam.live.monotonic_clock import nanoseconds
from collabslam.live.plan import LivePlan
from collabslam.live.views import LiveView, OwnPose, sender_of
from collabslam.types import Array

ROBOT_IMAGE, ROBOT_INFO = "/cs/image_raw", "/cs/camera_info"
WORN_IMAGE, WORN_INFO = "/cf/image/compressed", "/cf/camera_info"
T_CF, BIAS, OWN, RATE = "/t_cf", "/t_cf_bias", "/own_pose", "/cf/gyro"
"""Of the only worn camera; of several each begins with the person's name, as `own_topic` makes it."""
CLOCK, PLAN, ODOMETRY, GYRO = "/clock_readings", "/plan", "/odometry", "/gyro"
ROLES = {"cs": ROBOT_IMAGE, "cf": WORN_IMAGE, "t_cf": T_CF}
"""Topics as ``collabslam.open_recording(path, topics=...)`` takes them, if all cameras have one clock."""
_TYPES = {
    ROBOT_IMAGE: messages.IMAGE,
    WORN_IMAGE: messages.COMPRESSED,
    T_CF: messages.POSE,
    BIAS: messages.NUMBERS,
    OWN: messages.POSE,
    CLOCK: messages.TIMES,
    ODOMETRY: messages.TWIST,
    GYRO: messages.IMU,
    RATE: messages.IMU,
}
_ROBOT, _WORN = "cs_optical", "cf_optical"
_BESIDE = (T_CF, BIAS, OWN, RATE)
"""What tells of a view, written before it."""


class EventWriter:
    """Writes events into a bag; a context manager.

    Parameters
    ----------
    path : Path
        New folder.
    plan : LivePlan
    camera : Camera
    worn_cameras : mapping
        Each Cf by name; the names are the plan's persons, or  for a single one.

    Raises
    ------
    DataError
        If the folder exists or cannot be written, a camera's model has no name in ROS, or the extra ``ros``
        is not installed.
    """

    def __init__(
        self, path: Path, plan: LivePlan, camera: Camera, worn_cameras: Mapping[str, Camera]
    ) -> None:
        with needs("ros"):
            from rosbags.rosbag2 import StoragePlugin, Writer
        if path.exists():
            raise DataError(f"The folder {path} exists already; give another one for the record.")
        infos = [(ROBOT_INFO, _ROBOT, camera)]
        infos += [(own_topic(name, WORN_INFO), _WORN, lens) for name, lens in worn_cameras.items()]
        encoded = [(topic, messages.camera_info(0.0, frame, c)) for topic, frame, c in infos]
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._bag = Writer(path, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP)
            self._bag.open()
        except OSError as error:
            raise DataError(f"The record {path} cannot be written ({error}); give another place.") from error
        self._persons = set(worn_cameras)
        self._connections: dict[str, Any] = {}
        self._last = 0
        self._failed = self._ended = False
        self._write(PLAN, messages.TEXT, messages.text(plan.written), 0.0)
        for topic, data in encoded:
            self._write(topic, messages.CAMERA_INFO, data, 0.0)

    def __enter__(self) -> EventWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, event: Event, now: float) -> None:
        """Add an event at the robot's time ``now``, seconds; raises DataError if the disk is full."""
        if isinstance(event, RobotFrame):
            data = messages.raw_image(event.t, _ROBOT, event.image)
            self._write(ROBOT_IMAGE, messages.IMAGE, data, now)
        elif isinstance(event, ClockReading):
            self._write(CLOCK, messages.TIMES, messages.exchange(event.session, event.exchange), now)
        elif isinstance(event, OdometrySample):
            twist = messages.twist(event.t, event.twist, event.covariance)
            self._write(ODOMETRY, messages.TWIST, twist, now)
        elif isinstance(event, GyroSample):
            self._write(GYRO, messages.IMU, messages.rate(event.t, event.rate, event.acceleration), now)
        else:
            image, name = event.image, sender_of(event.session)
            name = name if name in self._persons else ""
            if not isinstance(image, bytes):
                raise DataError("A record holds encoded views; push JPEG or PNG.")
            if event.t_cf is not None and event.covariance is not None:
                pose = messages.pose(event.stamp, _ROBOT, event.t_cf, event.covariance)
                self._write(own_topic(name, T_CF), messages.POSE, pose, now)
                if event.bias is not None:
                    bias = messages.numbers(event.bias)
                    self._write(own_topic(name, BIAS), messages.NUMBERS, bias, now)
            if event.own is not None:
                own = messages.pose(event.stamp, event.session, event.own.t_xf, event.own.covariance)
                self._write(own_topic(name, OWN), messages.POSE, own, now)
            if event.rate is not None:
                rate = messages.rate(event.stamp, event.rate, frame=event.session)
                self._write(own_topic(name, RATE), messages.IMU, rate, now)
            data = messages.compressed_image(event.stamp, event.session, image)
            self._write(own_topic(name, WORN_IMAGE), messages.COMPRESSED, data, now)

    def close(self) -> None:
        """Finish the bag; what is still to be written then is most of a short one.

        Raises
        ------
        DataError
            If it cannot be written, unless that was told before.
        """
        if self._ended:
            return
        told, self._ended = self._failed, True
        try:
            self._bag.close()
        except OSError as error:
            if not told:
                raise _unwritable(error) from error

    def _write(self, topic: str, kind: str, data: bytes, now: float) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._bag.add_connection(topic, kind, typestore=messages.store())
        self._last = max(self._last + 1, nanoseconds(now))
        try:
            self._bag.write(self._connections[topic], self._last, data)
        except OSError as error:
            self._failed = True
            raise _unwritable(error) from error


def _unwritable(error: OSError) -> DataError:
    return DataError(f"The record cannot be written ({error}); free disk space.")


def own_topic(name: str, topic: str) -> str:
    """A topic of one of several persons; of the only worn camera, "", the topic itself."""
    return f"/{name}{topic}" if name else topic


class EventReader:
    """Reads what an `EventWriter` wrote.

    Attributes
    ----------
    plan : LivePlan
    camera : Camera
    worn_cameras : dict of Camera
        By name.

    Raises
    ------
    DataError
        If it is not such a bag, or broken.
    """

    def __init__(self, path: Path) -> None:
        self._bag = Bag(path)
        self._path = path
        topics = {t.name for t in self._bag.topics}
        if PLAN not in topics:
            raise DataError(
                f"The bag {path} is not a record of a live run; 'collabslam run' reads other bags."
            )
        _, message = next(self._bag.messages(PLAN, messages.TEXT))
        self.plan = LivePlan.of(str(message.data), str(path))
        self.camera = self._bag.camera(ROBOT_INFO)
        persons = self.plan.persons or ([""] if WORN_INFO in topics else [])
        self.worn_cameras = {name: self._bag.camera(own_topic(name, WORN_INFO)) for name in persons}

    def events(self) -> Iterator[Event]:
        """Each event in the order in which the filter took it; raises DataError if one is broken."""
        told = _Told()
        # "" too: views of who is none of the persons, which the filter drops in the replay as it did live.
        names = dict.fromkeys((*self.worn_cameras, ""))
        kinds = {own_topic(name, topic): topic for name in names for topic in (*_BESIDE, WORN_IMAGE)}
        kinds |= {topic: topic for topic in (ROBOT_IMAGE, CLOCK, ODOMETRY, GYRO)}
        self._check_types(kinds)
        for name, message in self._bag.all_messages(tuple(kinds)):
            topic = kinds[name]
            where = f"{name} in {self._path}"
            if topic in _BESIDE:
                told.take(topic, message, where)
            else:
                yield _checked(topic, message, where, told)

    def _check_types(self, kinds: Mapping[str, str]) -> None:
        for topic in self._bag.topics:
            wanted = _TYPES[kinds[topic.name]] if topic.name in kinds else topic.type
            if topic.type != wanted:
                raise DataError(
                    f"The topic {topic.name} of {self._path} is a {topic.type}, not a {wanted}; the record "
                    "is broken."
                )


class _Told:
    """What was told of the next view, by its stamp."""

    def __init__(self) -> None:
        self._poses: dict[float, Any] = {}
        self._owns: dict[float, OwnPose] = {}
        self._rates: dict[float, Array] = {}

    def take(self, topic: str, message: Any, where: str) -> None:
        """One of `_BESIDE`."""
        if topic == T_CF:
            self._poses = {messages.stamp_of(message): pose_and_covariance_of(message, where)}
        elif topic == BIAS:
            bias = _square(message, where)
            self._poses = {stamp: (*pose[:2], bias) for stamp, pose in self._poses.items()}
        elif topic == OWN:
            self._owns = {messages.stamp_of(message): OwnPose(*pose_and_covariance_of(message, where))}
        else:
            self._rates = {messages.stamp_of(message): messages.rate_of(message)}

    def of(self, view: LiveView) -> LiveView:
        """The view with all of it."""
        t_cf, covariance, bias = (*self._poses.get(view.stamp, ()), None, None, None)[:3]
        own, rate = self._owns.get(view.stamp), self._rates.get(view.stamp)
        return replace(view, t_cf=t_cf, covariance=covariance, bias=bias, own=own, rate=rate)


def _checked(topic: str, message: Any, where: str, told: _Told) -> Event:
    """A message as the event that it was; raises DataError."""
    try:
        return checked(_event(topic, message, where, told))
    except InputError as error:
        raise DataError(f"A message of {where} is none of a live run: {error}") from error


def _event(topic: str, message: Any, where: str, told: _Told) -> Event:
    if topic == ROBOT_IMAGE:
        return RobotFrame(messages.stamp_of(message), image_of(message, where))
    if topic == CLOCK:
        return ClockReading(*messages.exchange_of(message))
    if topic == ODOMETRY:
        return OdometrySample(messages.stamp_of(message), *twist_of(message))
    if topic == GYRO:
        rate, acceleration = messages.rate_of(message), messages.acceleration_of(message)
        return GyroSample(messages.stamp_of(message), rate, acceleration)
    stamp = messages.stamp_of(message)
    session, data = str(message.header.frame_id), message.data.tobytes()
    return told.of(LiveView(session, stamp, data))


def _square(message: Any, where: str) -> Array:
    if np.size(message.data) != 36:
        raise DataError(f"A message of {where} has {np.size(message.data)} numbers; 36 are needed.")
    return np.reshape(np.asarray(message.data, np.float64), (6, 6))

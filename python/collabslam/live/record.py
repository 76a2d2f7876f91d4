"""All that reached the filter as a ROS 2 bag (MCAP), in the order in which it did; and back."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.ros.bag import Bag
from collabslam.datasets.ros.messages import image_of, pose_and_covariance_of, twist_of
from collabslam.errors import DataError
from collabslam.extras import needs
from collabslam.live import messages
from collabslam.live.core import ClockReading, Event, OdometrySample, RobotFrame
from collabslam.live.steady import nanoseconds
from collabslam.live.views import LiveView, OwnPose
from collabslam.runs.results import jsonable
from collabslam.types import Board, Tag

ROBOT_IMAGE, ROBOT_INFO = "/cs/image_raw", "/cs/camera_info"
WORN_IMAGE, WORN_INFO = "/cf/image/compressed", "/cf/camera_info"
T_CF, BIAS, CLOCK, PLAN, ODOMETRY = "/t_cf", "/t_cf_bias", "/clock_readings", "/plan", "/odometry"
OWN = "/own_pose"
ROLES = {"cs": ROBOT_IMAGE, "cf": WORN_IMAGE, "t_cf": T_CF}
"""Topics as ``collabslam.open_recording(path, topics=...)`` takes them, if all cameras have one clock."""
_ROBOT, _WORN = "cs_optical", "cf_optical"


@dataclass(frozen=True)
class LivePlan:
    """What a live run was asked for: mode, start, settings by their full keys, printed targets as texts, and
    the 16 numbers of ``t_bc``, row by row, where there is odometry."""

    mode: str
    start: str
    settings: dict[str, Any]
    tags: list[str]
    boards: list[str]
    t_bc: list[float] | None = None

    @property
    def targets(self) -> list[Tag | Board]:
        """The printed targets."""
        return [*map(Tag.parse, self.tags), *map(Board.parse, self.boards)]


class EventWriter:
    """Writes events into a bag; a context manager.

    Parameters
    ----------
    path : Path
        New folder.
    plan : LivePlan
    camera, worn_camera : Camera, Camera or None

    Raises
    ------
    DataError
        If the folder exists or cannot be written, a camera's model has no name in ROS, or the extra ``ros``
        is not installed.
    """

    def __init__(self, path: Path, plan: LivePlan, camera: Camera, worn_camera: Camera | None) -> None:
        with needs("ros"):
            from rosbags.rosbag2 import StoragePlugin, Writer
        if path.exists():
            raise DataError(f"The folder {path} exists already; give another one for the record.")
        infos = [(ROBOT_INFO, _ROBOT, camera)]
        infos += [] if worn_camera is None else [(WORN_INFO, _WORN, worn_camera)]
        encoded = [(topic, messages.camera_info(0.0, frame, c)) for topic, frame, c in infos]
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._bag = Writer(path, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP)
            self._bag.open()
        except OSError as error:
            raise DataError(f"The record {path} cannot be written ({error}); give another place.") from error
        self._connections: dict[str, Any] = {}
        self._last = 0
        self._write(PLAN, messages.TEXT, messages.text(json.dumps(jsonable(vars(plan)))), 0.0)
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
        else:
            image = event.image
            if not isinstance(image, bytes):
                raise DataError("A record holds encoded views; push JPEG or PNG.")
            if event.t_cf is not None and event.covariance is not None:
                pose = messages.pose(event.stamp, _ROBOT, event.t_cf, event.covariance)
                self._write(T_CF, messages.POSE, pose, now)
                if event.bias is not None:
                    self._write(BIAS, messages.NUMBERS, messages.numbers(event.bias), now)
            if event.own is not None:
                own = messages.pose(event.stamp, event.session, event.own.t_xf, event.own.covariance)
                self._write(OWN, messages.POSE, own, now)
            data = messages.compressed_image(event.stamp, event.session, image)
            self._write(WORN_IMAGE, messages.COMPRESSED, data, now)

    def close(self) -> None:
        """Finish the bag."""
        with contextlib.suppress(OSError):
            self._bag.close()

    def _write(self, topic: str, kind: str, data: bytes, now: float) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._bag.add_connection(topic, kind, typestore=messages.store())
        self._last = max(self._last + 1, nanoseconds(now))
        try:
            self._bag.write(self._connections[topic], self._last, data)
        except OSError as error:
            raise DataError(f"The record cannot be written ({error}); free disk space.") from error


class EventReader:
    """Reads what an `EventWriter` wrote.

    Attributes
    ----------
    plan : LivePlan
    camera, worn_camera : Camera, Camera or None

    Raises
    ------
    DataError
        If it is no such bag, or broken.
    """

    def __init__(self, path: Path) -> None:
        self._bag = Bag(path)
        self._path = path
        topics = {t.name for t in self._bag.topics}
        if PLAN not in topics:
            raise DataError(f"The bag {path} is no record of a live run; 'collabslam run' reads other bags.")
        _, message = next(self._bag.messages(PLAN, messages.TEXT))
        try:
            self.plan = LivePlan(**json.loads(message.data))
        except (TypeError, ValueError) as error:
            raise DataError(f"The plan in {path} cannot be read ({error}); the record is broken.") from error
        self.camera = self._bag.camera(ROBOT_INFO)
        self.worn_camera = self._bag.camera(WORN_INFO) if WORN_INFO in topics else None

    def events(self) -> Iterator[Event]:
        """Each event in the order in which the filter took it."""
        poses: dict[float, Any] = {}
        owns: dict[float, OwnPose] = {}
        read = (ROBOT_IMAGE, CLOCK, ODOMETRY, T_CF, BIAS, OWN, WORN_IMAGE)
        for topic, message in self._bag.all_messages(read):
            where = f"{topic} in {self._path}"
            if topic == ROBOT_IMAGE:
                yield RobotFrame(messages.stamp_of(message), image_of(message, where))
            elif topic == CLOCK:
                yield ClockReading(*messages.exchange_of(message))
            elif topic == ODOMETRY:
                yield OdometrySample(messages.stamp_of(message), *twist_of(message))
            elif topic == T_CF:
                poses = {messages.stamp_of(message): pose_and_covariance_of(message, where)}
            elif topic == BIAS:
                bias = np.reshape(message.data, (6, 6))
                poses = {stamp: (*pose, bias) for stamp, pose in poses.items()}
            elif topic == OWN:
                owns = {messages.stamp_of(message): OwnPose(*pose_and_covariance_of(message, where))}
            else:
                stamp = messages.stamp_of(message)
                session, data = str(message.header.frame_id), message.data.tobytes()
                pose = poses.get(stamp, ())
                yield replace(LiveView(session, stamp, data, *pose), own=owns.get(stamp))

"""Where images come from: a camera of this machine, a video stream, or a recording at its own pace."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from collabslam.datasets.calibration import check_resolution, load_unmasked
from collabslam.datasets.imu.beside import NONE, GyroGiven
from collabslam.datasets.overrides import Given
from collabslam.datasets.ros.bag import Bag
from collabslam.datasets.ros.sensors import WornSensors, bag_sensors
from collabslam.datasets.source import Source
from collabslam.datasets.wrapped import OnlyPersons
from collabslam.errors import DataError, SettingsError
from collabslam.live.captures import Capture, OpenedDevice, OpenedStream
from collabslam.live.core import GyroSample
from collabslam.live.frame_source import CapturedImage, LiveCamera
from collabslam.live.gyro_topic import GyroTopic
from collabslam.live.monotonic_clock import MonotonicClock
from collabslam.live.playback import SensorPlayback
from collabslam.live.sensed import SensorTaker
from collabslam.live.wheels import WheelTopic
from collabslam.types import Array, Imu, ImuLog, Odometry, Recording, masks_of, worn_cameras

BROKEN = 30
"""So many reads running without an image end a camera."""
ROS_TOPIC = "ros:"
"""Before a topic's name, where a user names a camera."""
LEAD = 1.0
"""Seconds before a recording's first frame, in which devices learn of the clock."""


class DeviceCamera:
    """A camera that comes alone: ``/dev/video0``, or a stream by its address, ``rtsp://...``.

    An image's time is the one at which it was handed over: how long camera and driver had it is not known.

    Parameters
    ----------
    source : str
    calibration : Path

    Raises
    ------
    DataError
        If it cannot be opened.
    """

    t_bc = None
    imu = None

    def __init__(self, source: str, calibration: Path) -> None:
        self.name, self.camera, self.clock = "camera", load_unmasked(calibration), MonotonicClock()
        self._source = source
        self._capture: Capture = (
            OpenedStream(source) if "://" in source else OpenedDevice(source, self.camera)
        )

    def begin(self) -> None:
        """The clock runs since the camera was opened."""

    def hear(self, sensors: WornSensors, taker: SensorTaker) -> None:
        """It has none: what sensors say comes from elsewhere."""

    def drive(self, take: Callable[[float, Array, Array], None]) -> None:
        """No odometry comes with its images."""

    def turn(self, take: Callable[[GyroSample], None]) -> None:
        """No gyroscope's rates come with its images."""

    def images(self, ended: Callable[[], bool]) -> Iterator[CapturedImage]:
        """Each image as grey."""
        failed = 0
        try:
            while not ended():
                found = self._capture.read()
                failed = 0 if found is not None else failed + 1
                if failed >= BROKEN:
                    raise DataError(
                        f"The camera {self._source} delivers no more images; check its cable or link."
                    )
                if found is not None:
                    t, grey = found
                    check_resolution(self.camera, grey, f"of {self._source}")
                    yield CapturedImage(self.clock.now() - (time.monotonic() - t), grey)
        finally:
            self._capture.close()


class RecordingPlayback:
    """A recording at its own pace; this machine's clock shows the recording's time meanwhile.

    Parameters
    ----------
    recording : Recording
    bag : Path, optional
        Where the sensors' topics are.
    """

    def __init__(self, recording: Recording, bag: Path | None = None) -> None:
        self.recording, self._bag = recording, bag
        if masks_of(recording).any:
            raise SettingsError(
                f"{recording.name} has a mask, which a live run does not read; take the key 'mask' out of "
                "its calibration, or give LiveSlam a Slam(mask=...)."
            )
        self._odometry: Odometry | None = getattr(recording, "odometry", None)
        self.t_bc = None if self._odometry is None else self._odometry.t_bc
        self._log: ImuLog | None = getattr(recording, "imu", None)
        self.imu: Imu | None = None if self._log is None else self._log.sensor
        self._drive: Callable[[float, Array, Array], None] | None = None
        self._turn: Callable[[GyroSample], None] | None = None
        self._sensors: SensorPlayback | None = None
        self.name, self.camera = recording.name, recording.camera
        self.begin()

    def play(self, name: str) -> None:
        """From now on this is the recording of the person of that name, or of the only one.

        Raises
        ------
        SettingsError
            If there are several persons, and none of that name.
        """
        persons = list(worn_cameras(self.recording))
        if len(persons) > 1 and name not in persons:
            raise SettingsError(
                f"The recording {self.name} has views of {', '.join(persons)}; say whose to send with "
                f"--name, which is {name!r} now."
            )
        if persons:
            self.recording = OnlyPersons(self.recording, [name if name in persons else persons[0]])

    def begin(self) -> None:
        """The first frame comes `LEAD` seconds from now."""
        self.clock = MonotonicClock(float(self.recording.times[0]) - LEAD)

    def hear(self, sensors: WornSensors, taker: SensorTaker) -> None:
        """The bag's own sensors, at their times."""
        if self._bag is None:
            raise DataError(
                "The recording is not a bag with topics of scans and attitudes; leave --sensors out."
            )
        self._sensors = SensorPlayback(bag_sensors(Bag(self._bag), sensors), taker)

    def drive(self, take: Callable[[float, Array, Array], None]) -> None:
        """The recording's own odometry."""
        self._drive = take

    def turn(self, take: Callable[[GyroSample], None]) -> None:
        """The recording's own gyroscope."""
        self._turn = take

    def wait_until(self, t: float, now: Callable[[], float], ended: Callable[[], bool]) -> None:
        """Waits until ``now()``, the recording's time, is ``t``; the sensors go on meanwhile."""
        while (ahead := t - now()) > 0.0 and not ended():
            time.sleep(max(0.0, min(ahead, self._heard(t - ahead) - (t - ahead), 0.1)))
        self._heard(t)

    def _heard(self, t: float) -> float:
        """Sensors up to a time; when the next one is."""
        return float("inf") if self._sensors is None else self._sensors.up_to(t)

    def images(self, ended: Callable[[], bool]) -> Iterator[CapturedImage]:
        """Each frame at its time."""
        driven = turned = 0
        for i, t in enumerate(self.recording.times.tolist()):
            frame = self.recording.frame(i)
            self.wait_until(t, self.clock.now, ended)
            if ended():
                return
            driven, turned = self._driven(driven, t), self._turned(turned, t)
            yield CapturedImage(t, frame.image)

    def _driven(self, first: int, t: float) -> int:
        """Odometry from the first sample on up to a time; which is the next."""
        odometry = self._odometry
        if odometry is None or self._drive is None:
            return first
        last = int(np.searchsorted(odometry.times, t, side="right"))
        for k in range(first, last):
            self._drive(float(odometry.times[k]), odometry.twists[k], odometry.covariances[k])
        return last

    def _turned(self, first: int, t: float) -> int:
        """Rates from the first sample on that were taken up to a time; which is the next."""
        log = self._log
        if log is None or self._turn is None:
            return first
        last = int(np.searchsorted(log.times + log.sensor.time_offset, t, side="right"))
        for k in range(first, last):
            force = None if log.accelerations is None else log.accelerations[k]
            force = None if force is None or not np.isfinite(force).all() else force
            self._turn(GyroSample(float(log.times[k]), log.rates[k], force))
        return last


def open_camera(
    source: str,
    calibration: Path | None,
    topics: Mapping[str, str] | None = None,
    wheels: WheelTopic | None = None,
    gyro: GyroGiven | None = None,
) -> LiveCamera:
    """What a user names: a device, a URL, or a recording.

    Parameters
    ----------
    source : str
        ``/dev/video0`` or ``0``, a text with ``://``, ``ros:TOPIC``, or a path.
    calibration : Path or None
        Needed for the first two; a topic may have its own beside it, a recording has.
    topics : mapping, optional
        Of a bag, by their roles, as `collabslam.open_recording` takes them.
    wheels : WheelTopic, optional
        Odometry to go with the images of a topic, or a topic of a bag.
    gyro : GyroGiven, optional
        A gyroscope to go with a recording, in place of its own, or a topic to go with that of the images.

    Raises
    ------
    DataError
        If it cannot be opened.
    SettingsError
        If the calibration is missing, or there are no topics for ``wheels`` or ``gyro``.
    """
    path = Path(source)
    if source.startswith(ROS_TOPIC):
        from collabslam.live.ros_camera import RosCamera  # rclpy is there with ROS alone

        asked = None if gyro is None or gyro.source == NONE else gyro
        topic = None if asked is None else GyroTopic.asked(asked.source, asked.imu)
        return RosCamera(source.removeprefix(ROS_TOPIC), calibration, wheels, topic)
    if gyro is not None and not path.exists():
        raise SettingsError(
            f"The camera {source} has no gyroscope that --gyro and --imu could tell of; leave them out, or "
            "name a recording, or a topic as ros:TOPIC."
        )
    if source.isdigit() or source.startswith("/dev/video") or "://" in source:
        if calibration is None:
            raise SettingsError(f"The camera {source} carries no calibration; give it with --camera FILE.")
        if wheels is not None:
            raise SettingsError(
                f"The camera {source} has no topics; name one as ros:TOPIC, or leave --odometry out."
            )
        return DeviceCamera(source, calibration)
    odometry = None if wheels is None else wheels.given
    given = Given(calibration, topics=topics or {}, odometry=odometry, gyro=gyro)
    return RecordingPlayback(Source(path, given).open(), path)

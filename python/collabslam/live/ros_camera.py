"""A topic of ROS 2 as a live camera."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

from collabslam._core import Camera
from collabslam.datasets.calibration import check_resolution, load_unmasked
from collabslam.datasets.ros.sensors import WornSensors
from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.errors import CollabslamError, DataError
from collabslam.live import messages
from collabslam.live.core import GyroSample
from collabslam.live.frame_source import CapturedImage
from collabslam.live.gyro_topic import GyroTopic, sample_of
from collabslam.live.monotonic_clock import MonotonicClock
from collabslam.live.ros_types import ImageTopic, rclpy_of, subscribe
from collabslam.live.sensed import SensorTaker, sensor_topics
from collabslam.live.wheels import WheelSamples, WheelTopic
from collabslam.types import Array, Image, Imu

PATIENCE = 10.0
"""Seconds without a calibration, or without images, after which a topic counts as silent."""
APART = 1.0
"""Seconds by which an image's stamp may differ from this machine's time."""
WAITING = 4
"""Images that wait to be taken; the oldest gives way."""


class SystemClock(MonotonicClock):
    """The system's time, by which ROS stamps what it sends."""

    def now(self) -> float:
        """Seconds since 1970."""
        return time.time()


class RosCamera:
    """Images of a topic, Image or CompressedImage, at their own stamps.

    Parameters
    ----------
    topic : str
    calibration : Path or None
        Without it the calibration is that of the topic ``camera_info`` beside it.
    wheels : WheelTopic, optional
        Odometry.
    gyro : GyroTopic, optional
        A gyroscope.

    Raises
    ------
    DataError
        If ROS 2 is not there, or nobody tells the calibration, or how the wheels and the gyroscope sit.
    """

    def __init__(
        self,
        topic: str,
        calibration: Path | None,
        wheels: WheelTopic | None = None,
        gyro: GyroTopic | None = None,
    ) -> None:
        self.name, self.clock = "camera", SystemClock()
        self._topic = ImageTopic(topic)
        self._images: deque[tuple[float, Image]] = deque(maxlen=WAITING)
        self._cameras: list[Camera] = [] if calibration is None else [load_unmasked(calibration, topic=topic)]
        self._fault: CollabslamError | None = None
        rclpy = rclpy_of()
        self._context = rclpy.Context()
        self._context.init()
        self._node = rclpy.create_node("collabslam_camera", context=self._context)
        executors = import_module("rclpy.executors")
        self._executor = executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        info = f"{topic.removesuffix('/compressed').rpartition('/')[0]}/camera_info"
        self._kept = [
            subscribe(self._node, topic, self._topic.kind, self._image, self._refuse),
            subscribe(self._node, info, messages.CAMERA_INFO, self._info, self._refuse),
        ]
        self._wheels, self._fixed = wheels, TransformTree()
        self._frame = self._gyro_frame = ""
        self._take: Callable[[GyroSample], None] | None = None
        if gyro is not None:
            self._kept.append(subscribe(self._node, gyro.name, messages.IMU, self._rate, self._refuse))
        by_tf = wheels is not None and wheels.given.frames is not None
        if by_tf or (gyro is not None and gyro.asks_tf):
            self._kept.append(
                subscribe(
                    self._node, "/tf_static", messages.TRANSFORMS, self._links, self._refuse, latched=True
                )
            )
        self.t_bc: Array | None = None
        self.imu: Imu | None = None
        try:
            self._spin_until(lambda: bool(self._cameras), f"No calibration came on {info}")
            if wheels is not None:
                self._spin_until(
                    lambda: wheels.t_bc(self._fixed) is not None,
                    f"/tf_static did not say where {wheels.given.frames} are",
                )
                self.t_bc = wheels.t_bc(self._fixed)
            if gyro is not None:
                self._spin_until(
                    lambda: gyro.sensor(self._fixed, self._frame, self._gyro_frame) is not None,
                    f"Images and {gyro.name} did not come, or /tf_static did not link their frames",
                )
                self.imu = gyro.sensor(self._fixed, self._frame, self._gyro_frame)
        except BaseException:
            self._close()
            raise
        self.camera = self._topic.camera = self._cameras[0]

    def hear(self, sensors: WornSensors, taker: SensorTaker) -> None:
        """Sensors, too, as topics of the same ROS."""
        self._kept += [
            subscribe(self._node, topic, kind, take, self._refuse)
            for topic, kind, take in sensor_topics(sensors, taker)
        ]

    def drive(self, take: Callable[[float, Array, Array], None]) -> None:
        """Odometry, too, as a topic of the same ROS."""
        if self._wheels is None:
            return
        samples = WheelSamples(self._wheels)

        def sample(data: bytes) -> None:
            found = samples.take(data)
            if found is not None:
                take(*found)

        self._kept.append(subscribe(self._node, self._wheels.name, self._wheels.kind, sample, self._refuse))

    def turn(self, take: Callable[[GyroSample], None]) -> None:
        """The gyroscope, too."""
        self._take = take

    def begin(self) -> None:
        """The clock is the system's."""

    def images(self, ended: Callable[[], bool]) -> Iterator[CapturedImage]:
        """Each image when it comes, until ``ended()``.

        Raises
        ------
        DataError
            If no usable image comes for `PATIENCE` seconds.
        """
        try:
            while not ended():
                self._spin_until(
                    lambda: bool(self._images) or ended(), f"No image came on {self._topic.name}"
                )
                while self._images:
                    yield CapturedImage(*self._images.popleft())
        finally:
            self._close()

    def _image(self, data: bytes) -> None:
        t, image, self._frame = self._topic.stamped(data)
        off = self.clock.now() - t
        if abs(off) > APART:
            raise DataError(
                f"its images are stamped {off:.1f} s before this machine's time: let one clock set both "
                "machines, or give a recording by its path"
            )
        if self._cameras:
            check_resolution(self._cameras[0], image, f"of {self._topic.name}")
        self._images.append((t, image))

    def _info(self, data: bytes) -> None:
        if not self._cameras:
            self._cameras.append(
                messages.camera_from(data, f"CameraInfo beside {self._topic.name}", self._topic.name)
            )

    def _rate(self, data: bytes) -> None:
        self._gyro_frame, sample = sample_of(data)
        if self._take is not None:
            self._take(sample)

    def _links(self, data: bytes) -> None:
        self._fixed.take(messages.decoded(messages.TRANSFORMS, data), static=True)

    def _refuse(self, error: CollabslamError) -> None:
        self._fault = error

    def _spin_until(self, there: Callable[[], bool], fault: str) -> None:
        end = time.monotonic() + PATIENCE
        while not there():
            self._executor.spin_once(timeout_sec=0.1)
            if time.monotonic() > end:
                raise DataError(
                    f"{fault} for {PATIENCE:.0f} s ({self._fault or 'silence'}); see 'ros2 topic hz', "
                    "and give --camera FILE where there is no CameraInfo."
                )

    def _close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

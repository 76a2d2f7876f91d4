"""What delivers images while they are taken, and what it delivers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from collabslam._core import Camera
from collabslam.datasets.ros.sensors import WornSensors
from collabslam.live.core import GyroSample
from collabslam.live.monotonic_clock import MonotonicClock
from collabslam.live.sensed import SensorTaker
from collabslam.types import Array, Image, Imu


@dataclass(frozen=True)
class CapturedImage:
    """An image (H, W) uint8 taken at ``t`` seconds by this machine's clock."""

    t: float
    image: Image


class LiveCamera(Protocol):
    """What delivers images while they are taken."""

    @property
    def name(self) -> str: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def clock(self) -> MonotonicClock: ...
    @property
    def t_bc(self) -> Array | None:
        """Where it sits in the frame B of the odometry that comes with its images: maps points of the camera
        into B, metres (4, 4); None where none comes."""
        ...

    @property
    def imu(self) -> Imu | None:
        """The gyroscope whose rates come with its images; None where none come."""
        ...

    def begin(self) -> None:
        """The clock starts, if it has not."""
        ...

    def hear(self, sensors: WornSensors, taker: SensorTaker) -> None:
        """From now on ``taker`` is given what these sensors say, while images are; raises DataError."""
        ...

    def drive(self, take: Callable[[float, Array, Array], None]) -> None:
        """From now on ``take`` is given stamp, twist and covariance of odometry, while images are."""
        ...

    def turn(self, take: Callable[[GyroSample], None]) -> None:
        """From now on ``take`` is given the samples of the gyroscope, while images are."""
        ...

    def images(self, ended: Callable[[], bool]) -> Iterator[CapturedImage]:
        """Each image when it is taken, until there are no more or ``ended()``; raises DataError."""
        ...

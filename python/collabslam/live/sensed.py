"""T_CF from laser scans and AHRSs while they come, for images that wait for them (METHOD 11)."""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from collabslam.datasets.ros.messages import imu_of, scans_of
from collabslam.datasets.ros.sensors import WornSensors
from collabslam.errors import DataError, InputError
from collabslam.live import messages
from collabslam.types import Array
from collabslam.worn_pose import LaserScan, WornPoseConfig, WornPoseEstimator, ahrs_readings, laser_scans
from collabslam.worn_pose.readings import AhrsReading, Wearer

WAITING = 64
"""Scans and images that wait for attitudes; the oldest gives way."""


class SensorTaker(Protocol):
    """What takes scans and attitudes."""

    def scan(self, scan: LaserScan) -> None:
        """A scan."""
        ...

    def reading(self, reading: AhrsReading) -> None:
        """An attitude."""
        ...


class SensedPoses:
    """Estimates T_CF at the instants of Cf's images, with the scans up to each and no later one.

    Scans and images wait until both AHRSs have told what was a little after them: then all that was before
    has come, whatever order it came in, and the estimates are those of the same readings in a bag.

    Parameters
    ----------
    config : WornPoseConfig
    reasons : Counter, optional
        Where to count why there was no pose for an image, or a scan was not used.
    """

    def __init__(self, config: WornPoseConfig, reasons: Counter[str] | None = None) -> None:
        self.reasons: Counter[str] = Counter() if reasons is None else reasons
        self._estimator = WornPoseEstimator(config)
        self._after = 2.0 * config.max_ahrs_age
        self._heard: dict[Wearer, float] = {"robot": -float("inf"), "worn": -float("inf")}
        self._waiting: list[tuple[float, bool, int, Any]] = []
        self._count = itertools.count()

    def reading(self, reading: AhrsReading) -> None:
        """An attitude; raises InputError if it is not later than the one before."""
        self._estimator.add_ahrs(reading)
        self._heard[reading.where] = reading.t

    def scan(self, scan: LaserScan) -> None:
        """A scan."""
        self._wait(scan.t + 0.5 * scan.time_increment * (len(scan.ranges) - 1), scan, image=False)

    def add(self, t: float, name: Any) -> None:
        """An image was taken at ``t`` seconds by the robot's clock; ``name`` is what `known` calls it."""
        self._wait(t, name, image=True)

    def known(self) -> list[tuple[Any, Array, Array, Array | None]]:
        """Name, T_CF (4, 4), covariance (6, 6) and what of it lasts, of each image that is due.

        A scan that is not later than the one before, or of an unknown scanner, is left out and counted.
        """
        due = min(self._heard.values()) - self._after
        found = []
        while self._waiting and self._waiting[0][0] <= due:
            t, image, _, item = heapq.heappop(self._waiting)
            if not image:
                try:
                    self._estimator.add_scan(item)
                except InputError:
                    self.reasons["a scan came too late, or is of no known scanner"] += 1
                continue
            estimate = self._estimator.pose_at(t)
            if estimate.t_cf is None or estimate.covariance is None:
                self.reasons[str(estimate.reason)] += 1
            else:
                found.append((item, estimate.t_cf, estimate.covariance, estimate.bias))
        return found

    def _wait(self, t: float, item: Any, *, image: bool) -> None:
        """Scans come before images of their instant."""
        heapq.heappush(self._waiting, (t, image, next(self._count), item))
        if len(self._waiting) > WAITING:
            heapq.heappop(self._waiting)


def sensor_topics(sensors: WornSensors, taker: SensorTaker) -> list[tuple[str, str, Callable[[bytes], None]]]:
    """Topic, type and what takes its messages in CDR, of the sensors that a file names."""

    def scan(name: str, data: bytes) -> None:
        taker.scan(scan_from(messages.decoded(messages.SCAN, data), name))

    def reading(where: Wearer, data: bytes) -> None:
        taker.reading(reading_from(messages.decoded(messages.IMU, data), where))

    return [
        *((topic, messages.SCAN, partial(scan, name)) for name, topic in sensors.scans.items()),
        *((topic, messages.IMU, partial(reading, where)) for where, topic in sensors.ahrs.items()),
    ]


def scan_from(message: Any, scanner: str) -> LaserScan:
    """A LaserScan message; raises DataError."""
    try:
        found = scans_of([(messages.stamp_of(message), message)])
        step = float(found.angles[1] - found.angles[0]) if len(found.angles) > 1 else 0.0
        (scan,) = laser_scans(
            found.times,
            found.ranges,
            float(found.angles[0]) if len(found.angles) else 0.0,
            step,
            scanner=scanner,
            range_max=found.range_max,
            time_increment=found.time_increment,
        )
    except InputError as error:
        raise DataError(f"The scan of {scanner} is not usable: {error}") from error
    return scan


def reading_from(message: Any, where: Wearer) -> AhrsReading:
    """The attitude of an Imu message; raises DataError."""
    imu = imu_of([(messages.stamp_of(message), message)])
    try:
        (reading,) = ahrs_readings(imu.times, imu.orientation[:, [1, 2, 3, 0]], where)
    except InputError as error:
        raise DataError(f"The attitude of the {where} is not usable: {error}") from error
    return reading

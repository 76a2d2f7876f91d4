"""A bag's scans and attitudes, handed over when their time has come."""

from __future__ import annotations

from collections import deque

from collabslam.datasets.ros.sensors import EstimatedPoses
from collabslam.live.sensed import SensorTaker
from collabslam.worn_pose import AhrsReading, LaserScan


class SensorPlayback:
    """What is left of a bag's readings, in order of the instants at which they were complete.

    Parameters
    ----------
    found : EstimatedPoses
    taker : SensorTaker
    """

    def __init__(self, found: EstimatedPoses, taker: SensorTaker) -> None:
        self._taker = taker
        readings: list[LaserScan | AhrsReading] = [*found.scans, *found.readings]
        self._left = deque(sorted(readings, key=_complete))

    def up_to(self, t: float) -> float:
        """Hands over what was complete at ``t`` seconds; gives the next one's time, infinite without one."""
        while self._left and _complete(self._left[0]) <= t:
            reading = self._left.popleft()
            if isinstance(reading, LaserScan):
                self._taker.scan(reading)
            else:
                self._taker.reading(reading)
        return _complete(self._left[0]) if self._left else float("inf")


def _complete(reading: LaserScan | AhrsReading) -> float:
    if isinstance(reading, LaserScan):
        return reading.t + reading.time_increment * (len(reading.ranges) - 1)
    return reading.t

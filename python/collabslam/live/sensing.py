"""The robot's side of sensors: T_CF of images that came without it, from scans and attitudes as they come."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable

from collabslam.errors import InputError
from collabslam.live.senders import SILENT
from collabslam.live.sensed import SensedPoses
from collabslam.types import Array
from collabslam.worn_pose import AhrsReading, LaserScan, WornPoseConfig

Known = Callable[[tuple[str, float], Array, Array, "Array | None"], None]
"""Is given device and stamp of an image, T_CF (4, 4), its covariance (6, 6) and what of that lasts."""


class Sensing:
    """Scans and attitudes of the robot and of one worn device; any thread may call.

    The attitudes are those of the device that told one first; another one takes over, with a person that has
    to be found anew, once it has been silent for `SILENT` seconds.

    Parameters
    ----------
    config : WornPoseConfig
    known : callable
        See `Known`.
    """

    def __init__(self, config: WornPoseConfig, known: Known) -> None:
        self.reasons: Counter[str] = Counter()
        """Why there was no pose for an image, or a reading was not used, and how often."""
        self._config, self._known = config, known
        self._sensed = SensedPoses(config, self.reasons)
        self._lock = threading.Lock()
        self._device, self._heard = "", -float("inf")

    def scan(self, scan: LaserScan) -> None:
        """A scan by the robot's clock."""
        self._take(lambda sensed: sensed.scan(scan))

    def reading(self, reading: AhrsReading) -> None:
        """An attitude of the robot by its clock."""
        self._take(lambda sensed: sensed.reading(reading))

    def worn(self, device: str, reading: AhrsReading) -> None:
        """An attitude of a worn device by the robot's clock."""
        with self._lock:
            if device != self._device:
                if reading.t - self._heard <= SILENT:
                    self.reasons["another device's attitudes are used"] += 1
                    return
                if self._device:
                    self._sensed = SensedPoses(self._config, self.reasons)
                self._device = device
            self._heard = max(self._heard, reading.t)
        self._take(lambda sensed: sensed.reading(reading))

    def image(self, device: str, stamp: float, t: float) -> None:
        """A device took an image at ``stamp`` by its own clock, at ``t`` by the robot's, seconds."""
        with self._lock:
            if device == self._device:
                self._sensed.add(t, (device, stamp))

    def _take(self, give: Callable[[SensedPoses], None]) -> None:
        """Gives something to the estimator and hands on what is known then."""
        with self._lock:
            try:
                give(self._sensed)
            except InputError:
                self.reasons["an attitude came after a later one"] += 1
            found = self._sensed.known()
        for name, t_cf, covariance, bias in found:
            self._known(name, t_cf, covariance, bias)

"""What a worn camera sees, sent as it is taken; a recording's views when the robot's time is theirs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from collabslam.datasets.ros.sensors import WornSensors
from collabslam.errors import SettingsError
from collabslam.live.cameras import DeviceCamera, RecordingPlayback
from collabslam.live.device_rates import DeviceRates
from collabslam.live.frame_source import LiveCamera
from collabslam.live.monotonic_clock import MonotonicClock
from collabslam.live.worn import WornDevice
from collabslam.types import Array, Frame, Image
from collabslam.worn_pose import AhrsReading, LaserScan

OVERDUE = 0.25
"""Seconds after which a recording's view is not sent any more."""
_EARLY = 0.9
"""Share of the time between two images after which the next one may come: cameras are not that regular."""


def send_all(device: WornDevice, camera: LiveCamera, ended: Callable[[], bool]) -> None:
    """Sends images, no faster than the device's pace, until the camera ends or ``ended()``.

    Raises
    ------
    DataError
        If the camera delivers no more.
    """
    if isinstance(camera, RecordingPlayback):
        _follow(device, camera, ended)
        return
    rates = _rates_of(camera)
    last = -float("inf")
    for captured in camera.images(ended):
        if captured.t - last >= _EARLY / device.pace.level.rate:
            device.send(captured.t, captured.image, rate=rates.at("", captured.t))
            last = captured.t


def _rates_of(camera: LiveCamera) -> DeviceRates:
    """What the gyroscope that comes with a camera's images says, along the camera's axes, by its clock."""
    rates, imu = DeviceRates(), camera.imu
    if imu is not None:
        camera.turn(lambda sample: rates.add("", sample.t + imu.time_offset, imu.r_ci @ sample.rate))
    return rates


def send_sensors(device: WornDevice, camera: LiveCamera, sensors: WornSensors) -> None:
    """Sends what these sensors say, while `send_all` sends images.

    Raises
    ------
    DataError
        If they cannot be heard.
    SettingsError
        If the camera is one that comes alone.
    """
    if isinstance(camera, DeviceCamera):
        raise SettingsError("A camera has no AHRS; give SOURCE as ros:TOPIC, or leave --sensors out.")
    played = isinstance(camera, RecordingPlayback)
    camera.hear(sensors, _Retimed(device, camera.clock) if played else device)


class _Retimed:
    """Sends a recording's readings with stamps by the device's clock."""

    def __init__(self, device: WornDevice, clock: MonotonicClock) -> None:
        self._device, self._clock = device, clock

    def scan(self, scan: LaserScan) -> None:
        self._device.scan(replace(scan, t=self._stamp(scan.t)))

    def reading(self, reading: AhrsReading) -> None:
        self._device.reading(replace(reading, t=self._stamp(reading.t)))

    def _stamp(self, t: float) -> float:
        return self._device.stamp_at(t, self._clock.now())


def _follow(device: WornDevice, camera: RecordingPlayback, ended: Callable[[], bool]) -> None:
    """Plays the moment that the robot plays."""
    while not device.wait_for_robot(0.2):
        if ended():
            return
    last = -float("inf")
    for i, t in enumerate(camera.recording.times.tolist()):
        if t - last < _EARLY / device.pace.level.rate or device.behind(t) > OVERDUE:
            continue
        view = _view(camera.recording.frame(i), alone=camera.recording.worn_camera is None)
        camera.wait_until(t, lambda: device.behind(0.0), ended)
        if ended():
            return
        if view is not None and device.behind(t) <= OVERDUE:
            taken, image, pose, rate = view
            device.send(device.stamp_at(taken, camera.clock.now()), image, pose, rate)
            last = t


def _view(
    frame: Frame, *, alone: bool
) -> tuple[float, Image, tuple[Array, Array] | None, Array | None] | None:
    """When a frame's view of Cf was taken, its image, T_CF and covariance, and how Cf turned; the image where
    Cf is alone."""
    if alone:
        return frame.t, frame.image, None, None
    if not frame.views:
        return None
    worn = frame.views[0]
    return frame.t if worn.t is None else worn.t, worn.image, (worn.t_cf, worn.covariance), worn.rate

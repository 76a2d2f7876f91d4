"""What a worn camera sees, sent as it is taken; a recording's views when the robot's time is theirs."""

from __future__ import annotations

import time
from collections.abc import Callable

from collabslam.live.cameras import PlayedRecording
from collabslam.live.shots import LiveCamera
from collabslam.live.worn import WornDevice

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
    if isinstance(camera, PlayedRecording):
        _follow(device, camera, ended)
        return
    last = -float("inf")
    for shot in camera.shots(ended):
        if shot.t - last >= _EARLY / device.pace.level.rate:
            device.send(shot.t, shot.image)
            last = shot.t


def _follow(device: WornDevice, camera: PlayedRecording, ended: Callable[[], bool]) -> None:
    """Plays the moment that the robot plays."""
    while not device.wait_for_robot(0.2):
        if ended():
            return
    last = -float("inf")
    for i, t in enumerate(camera.recording.times.tolist()):
        if t - last < _EARLY / device.pace.level.rate or device.behind(t) > OVERDUE:
            continue
        worn = camera.recording.frame(i).worn
        while (ahead := -device.behind(t)) > 0.0 and not ended():
            time.sleep(min(ahead, 0.1))
        if ended():
            return
        if worn is not None and device.behind(t) <= OVERDUE:
            stamp = device.stamp_at(t, camera.clock.now())
            device.send(stamp, worn.image, (worn.t_cf, worn.covariance))
            last = t

"""Where images come from: a camera of this machine, a video stream, or a recording at its own pace."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from collabslam.datasets.calibration import check_resolution, load_camera
from collabslam.datasets.source import Source
from collabslam.errors import DataError, SettingsError
from collabslam.live.shots import LiveCamera, Shot
from collabslam.live.steady import SteadyClock
from collabslam.types import Image, Recording

BROKEN = 30
"""So many reads running without an image end a camera."""
ROS_TOPIC = "ros:"
"""Before a topic's name, where a user names a camera."""
LEAD = 1.0
"""Seconds before a recording's first frame, in which devices learn of the clock."""


class DeviceCamera:
    """A camera that OpenCV opens: ``/dev/video0``, ``rtsp://...``, any URL of a video stream.

    An image's time is the one at which it was handed over: how long camera and driver had it is not known.

    Parameters
    ----------
    source : str
    calibration : Path
    """

    def __init__(self, source: str, calibration: Path) -> None:
        self.name, self.camera, self.clock = "camera", load_camera(calibration), SteadyClock()
        self._source = source
        number = source.removeprefix("/dev/video")
        self._capture = cv2.VideoCapture(int(number)) if number.isdigit() else cv2.VideoCapture(source)
        if not self._capture.isOpened():
            raise DataError(f"The camera {source} cannot be opened; is it there, and not in use by another?")
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self.camera.width)
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self.camera.height)
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)

    def begin(self) -> None:
        """The clock runs since the camera was opened."""

    def shots(self, ended: Callable[[], bool]) -> Iterator[Shot]:
        """Each image as grey."""
        failed = 0
        try:
            while not ended():
                there = self._capture.grab()
                t = self.clock.now()
                there, image = self._capture.retrieve() if there else (False, None)
                failed = 0 if there else failed + 1
                if failed >= BROKEN:
                    raise DataError(
                        f"The camera {self._source} delivers no more images; check its cable or link."
                    )
                if image is not None and there:
                    grey: Image = np.asarray(
                        image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8
                    )
                    check_resolution(self.camera, grey, f"of {self._source}")
                    yield Shot(t, grey)
        finally:
            self._capture.release()


class PlayedRecording:
    """A recording at its own pace; this machine's clock shows the recording's time meanwhile.

    Parameters
    ----------
    recording : Recording
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.name, self.camera = recording.name, recording.camera
        self.begin()

    def begin(self) -> None:
        """The first frame comes `LEAD` seconds from now."""
        self.clock = SteadyClock(float(self.recording.times[0]) - LEAD)

    def shots(self, ended: Callable[[], bool]) -> Iterator[Shot]:
        """Each frame at its time."""
        for i, t in enumerate(self.recording.times.tolist()):
            frame = self.recording.frame(i)
            while (ahead := t - self.clock.now()) > 0.0 and not ended():
                time.sleep(min(ahead, 0.1))
            if ended():
                return
            yield Shot(t, frame.image, frame.worn)


def open_camera(source: str, calibration: Path | None, given: Source | None = None) -> LiveCamera:
    """What a user names: a device, a URL, or a recording.

    Parameters
    ----------
    source : str
        ``/dev/video0`` or ``0``, a text with ``://``, ``ros:TOPIC``, or a path.
    calibration : Path or None
        Needed for the first two; a topic may have its own beside it.
    given : Source, optional
        How a recording is opened, if not just by its path.

    Raises
    ------
    DataError
        If it cannot be opened.
    SettingsError
        If the calibration is missing.
    """
    if source.startswith(ROS_TOPIC):
        from collabslam.live.ros_camera import RosCamera  # rclpy is there with ROS alone

        return RosCamera(source.removeprefix(ROS_TOPIC), calibration)
    if source.isdigit() or source.startswith("/dev/video") or "://" in source:
        if calibration is None:
            raise SettingsError(f"The camera {source} carries no calibration; give it with --camera FILE.")
        return DeviceCamera(source, calibration)
    return PlayedRecording((given or Source(Path(source))).open())

"""Where images of a live camera come from: a device of this machine, which is trusted, or a stream."""

from __future__ import annotations

import time
from typing import Protocol

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.errors import DataError
from collabslam.formats.video_worker import retrieved
from collabslam.formats.worker_process import WorkerDied, WorkerProcess
from collabslam.live.stream_worker import NEXT, OPENED, READY, SHAPE, environment
from collabslam.types import Image

PATIENCE = 90.0
"""Seconds of waiting for a stream; FFmpeg itself gives up after 30."""


class Capture(Protocol):
    """What hands over images as they come."""

    def read(self) -> tuple[float, Image] | None:
        """When the next image was there, by ``time.monotonic``, and it, (H, W) uint8; None if none came."""
        ...

    def close(self) -> None: ...


class OpenedDevice:
    """A camera of this machine, ``/dev/video0`` or ``0``: its driver is trusted as this program is.

    Parameters
    ----------
    source : str
    camera : Camera
        Its images' size is asked for.

    Raises
    ------
    DataError
        If it cannot be opened.
    """

    def __init__(self, source: str, camera: Camera) -> None:
        number = source.removeprefix("/dev/video")
        self._capture = cv2.VideoCapture(int(number)) if number.isdigit() else cv2.VideoCapture(source)
        if not self._capture.isOpened():
            raise DataError(f"The camera {source} cannot be opened; is it there, and not in use by another?")
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, camera.width)
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, camera.height)
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)

    def read(self) -> tuple[float, Image] | None:
        """As `Capture.read`."""
        if not self._capture.grab():
            return None
        t = time.monotonic()
        image = retrieved(self._capture)
        return None if image is None else (t, image)

    def close(self) -> None:
        """Let others have it."""
        self._capture.release()


class OpenedStream:
    """A stream by its address, decoded by a process of its own (`stream_worker`), as others may send by it.

    Parameters
    ----------
    url : str

    Raises
    ------
    DataError
        If it cannot be opened, or what it sends costs more than a stream may.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._worker = WorkerProcess("collabslam.live.stream_worker", url, environment=environment())
        if self._ask(OPENED) != READY:
            self.close()
            raise DataError(
                f"The stream {url} cannot be opened; is it there, and one of rtsp, rtp, rtmp, or a film over "
                "http? A file is named by its path."
            )

    def read(self) -> tuple[float, Image] | None:
        """As `Capture.read`; raises DataError if it costs more than a stream may."""
        told = self._ask(NEXT)
        if len(told) < SHAPE.size:
            return None
        t, height, width = SHAPE.unpack_from(told)
        return t, np.array(np.frombuffer(told, np.uint8, offset=SHAPE.size).reshape(height, width))

    def close(self) -> None:
        """End the process."""
        self._worker.close()

    def _ask(self, asked: bytes) -> bytes:
        try:
            return self._worker.ask(asked, PATIENCE)
        except WorkerDied as error:
            raise DataError(
                f"The stream {self._url} sends nothing, or what takes more memory or time than an image may; "
                "check what sends it."
            ) from error

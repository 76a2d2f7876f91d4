"""A video file with ``--camera FILE``; frame times are the container's, or ``--times FILE``."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np

from collabslam.datasets.calibration import load_camera
from collabslam.datasets.gate import data_lines, tell
from collabslam.datasets.overrides import Given
from collabslam.datasets.stream import StreamRecording
from collabslam.datasets.units import as_seconds, listed_stamps
from collabslam.errors import DataError
from collabslam.types import Array, Image

LAYOUT = "a video file (.mp4, .avi, .mkv, .mov, .webm, .m4v) with --camera CAMERA.yaml"
SUFFIXES = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v")


def matches(path: Path) -> bool:
    """Whether ``path`` is a video file."""
    return path.is_file() and path.suffix.lower() in SUFFIXES


def open(path: Path, given: Given) -> StreamRecording:
    """Open a video.

    Raises
    ------
    DataError
        If it cannot be decoded, or the calibration is missing.
    """
    if given.camera is None:
        raise DataError(
            f"The video {path} carries no calibration; give it with --camera FILE. 'collabslam init {path} "
            "--board 7x5:0.03' makes it from a film of a checkerboard, 'collabslam init --phone' guesses."
        )
    video = Video(path)
    times = video.times if given.times is None else read_stamps(given.times, video)
    return StreamRecording(path.stem, str(path), load_camera(given.camera), times, video.read)


def read_stamps(path: Path, video: Video) -> Array:
    """Stamps of a video's frames, seconds: the first column of a CSV or text file.

    Raises
    ------
    DataError
        If there is not one for each frame, or one is not a number.
    """
    times = as_seconds(listed_stamps(data_lines(path), str(path))[0])
    if len(times) != len(video.times):
        raise DataError(f"{path} has {len(times)} stamps for {len(video.times)} frames; match them.")
    return times


def frame_size(path: Path) -> tuple[int, int]:
    """(width, height) of a video's frames."""
    capture = _capture(path)
    width, height = (capture.get(p) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    return int(width), int(height)


def _capture(path: Path) -> cv2.VideoCapture:
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # what its decoders say of frames is not for users
    capture = cv2.VideoCapture(str(path))
    if not capture.isOpened():
        raise DataError(f"The video {path} cannot be decoded; convert it to another format.")
    return capture


_AHEAD = 100
"""A frame so far ahead is sought, a nearer one reached by decoding what lies between."""
_BEFORE = 32
"""Frames before the wanted one from which on it is decoded: the first ones after a jump may lack others."""


class Video:
    """Frames of a video by number; quickest in order.

    Others are sought: the frame that is met there is known by its stamp, and where it is not, the video is
    decoded from its beginning.

    Attributes
    ----------
    times : (N,) float64
        The container's stamps, seconds; from its frame rate where it carries none.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._capture, self._next = _capture(self._path), 0
        stamps = []
        while self._capture.grab():
            stamps.append(self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self._next = len(stamps)
        self.times: Array = np.asarray(stamps, dtype=np.float64)
        self._frames = {} if len(set(stamps)) < len(stamps) else {t: k for k, t in enumerate(stamps)}
        source = "the container's"
        if not np.all(np.diff(self.times) > 0.0):  # some containers carry no stamps
            if not rate > 0.0:
                raise DataError(
                    f"The video {path} carries neither stamps nor a frame rate; give --times FILE."
                )
            self.times, source = np.arange(len(stamps)) / rate, f"{rate:g} a second, by the container"
        tell("stamps", f"{len(stamps)}, {source}", path)

    def read(self, i: int) -> Image:
        """The (H, W) uint8 grey image of frame ``i``; DataError if it cannot be decoded."""
        if not self._next <= i <= self._next + _AHEAD:
            self._seek(i)
        while self._next < i and self._capture.grab():
            self._next += 1
        done, image = self._capture.read()
        if not done or self._next != i:
            raise DataError(f"The frame {i} of {self._path} cannot be decoded; convert the video again.")
        self._next = i + 1
        return np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)

    def _seek(self, i: int) -> None:
        """Let the next frame be one that is not after frame ``i``."""
        target = i - _BEFORE
        if target > 0 and self._frames:
            self._capture.set(cv2.CAP_PROP_POS_FRAMES, target)
            if self._capture.grab():
                met = self._frames.get(self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
                if met is not None and met < i:
                    self._next = met + 1
                    return
        self._capture, self._next = _capture(self._path), 0

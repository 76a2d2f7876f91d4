"""A video file with ``--camera FILE``; frame times are the container's, or ``--times FILE``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam.datasets.calibration import load_camera
from collabslam.datasets.gate import data_lines, leave_columns, tell
from collabslam.datasets.overrides import Given
from collabslam.datasets.stream import StreamRecording
from collabslam.datasets.units import as_seconds, listed_stamps
from collabslam.errors import DataError
from collabslam.formats.video import VideoFile
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
    stamps, further = listed_stamps(data_lines(path), str(path))
    leave_columns(further, 0, f"{path}, behind the stamps")
    times = as_seconds(stamps)
    if len(times) != len(video.times):
        raise DataError(f"{path} has {len(times)} stamps for {len(video.times)} frames; match them.")
    return times


class Video:
    """Frames of a video by number; quickest in order (see `video_worker`).

    Attributes
    ----------
    times : (N,) float64
        The container's stamps, seconds; from its frame rate where it carries none.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, VideoFile(path)
        rate = self._file.rate
        self.times: Array = self._file.stamps()
        source = "the container's"
        if not np.all(np.diff(self.times) > 0.0):  # some containers carry no stamps
            if not rate > 0.0:
                raise DataError(
                    f"The video {path} carries neither stamps nor a frame rate; give --times FILE."
                )
            self.times, source = np.arange(len(self.times)) / rate, f"{rate:g} a second, by the container"
        tell("stamps", f"{len(self.times)}, {source}", path)

    def read(self, i: int) -> Image:
        """The (H, W) uint8 grey image of frame ``i``; DataError if it cannot be decoded."""
        image = self._file.read(i)
        if image is None:
            raise DataError(f"The frame {i} of {self._path} cannot be decoded; convert the video again.")
        return image

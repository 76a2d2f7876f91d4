"""Frames of a video file, decoded by a process of its own under limits of memory, time and pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam.errors import DataError
from collabslam.formats.files import require_regular
from collabslam.formats.video_worker import FACTS, NUMBER, SHAPE, SIZE, STAMPS, environment
from collabslam.formats.worker_process import WorkerDied, WorkerProcess
from collabslam.types import Array, Image

PATIENCE = 600.0
"""Seconds of waiting for a frame: far more than its processor time, of which the process has a limit."""
FOREVER = 1e6
"""Seconds of waiting for all stamps, which are as many as there are frames."""


class VideoFile:
    """A video file that is decoded frame by frame; quickest in order.

    Parameters
    ----------
    path : Path

    Raises
    ------
    DataError
        If it cannot be decoded, or costs more than a video may (see `video_worker`).
    """

    def __init__(self, path: Path) -> None:
        require_regular(path)
        self._path = path
        self._worker: WorkerProcess | None = None
        told = self._ask(SIZE)
        if len(told) != FACTS.size:
            raise DataError(f"The video {path} cannot be decoded; convert it to another format.")
        self.width, self.height, self.rate = FACTS.unpack(told)
        """Pixels, and frames per second by the container, 0 where it does not tell."""

    def stamps(self) -> Array:
        """(N,) seconds by the container, of each frame that can be decoded."""
        return np.frombuffer(self._ask(STAMPS, FOREVER), ">f8").astype(np.float64)

    def read(self, i: int) -> Image | None:
        """The (H, W) uint8 grey image of frame ``i``; None if it cannot be decoded.

        Raises
        ------
        DataError
            If it costs more than a frame may.
        """
        told = self._ask(NUMBER.pack(i))
        if len(told) < SHAPE.size:
            return None
        height, width = SHAPE.unpack_from(told)
        return np.array(np.frombuffer(told, np.uint8, offset=SHAPE.size).reshape(height, width))

    def _ask(self, asked: bytes, patience: float = PATIENCE) -> bytes:
        if self._worker is None:
            # absolute, as nothing that begins with a dash or names a protocol is a path then
            name = str(self._path.absolute())
            self._worker = WorkerProcess("collabslam.formats.video_worker", name, environment=environment())
        try:
            return self._worker.ask(asked, patience)
        except WorkerDied as error:
            raise DataError(
                f"The video {self._path} takes more memory or time than a video may; convert it to another "
                "format, or to a smaller size."
            ) from error
        except BaseException:
            self._worker = None  # broken off in the middle of an answer
            raise

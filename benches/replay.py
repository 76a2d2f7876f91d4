"""A recorded replay through the Python package, frame by frame: what ``compare.py`` sets beside the Rust one.

Reads the recording, one line, from standard input and answers with nanoseconds of each frame, ``ns|ns|...``.
The argument says how often the replay is run.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from collabslam._core import Camera, DepthMeasurement, Filter, FilterSettings
from collabslam.types import Array, Indices

CAMERA = Camera("pinhole", 720, 480, (600.0, 600.0, 360.0, 240.0), [])
Frame = tuple[float, Indices, Array]


class Replay:
    """The recorded frames through the Python package, one at a time."""

    def __init__(self, lines: str) -> None:
        self._births: list[tuple[Frame, Array]] = []
        self._frames: list[Frame] = []
        for line in lines.split("|"):
            t, *parts = line.split(";")
            rows = [[float(x) for x in part.split(",")] for part in parts]
            seen = np.array([row for row in rows if len(row) == 3]).reshape(-1, 3)
            frame = float(t), seen[:, 0].astype(np.int64), np.ascontiguousarray(seen[:, 1:])
            births = np.array([row for row in rows if len(row) == 4])
            if len(births):
                self._births.append((frame, births))
            else:
                self._frames.append(frame)
        self._next = len(self._frames)
        self._filter = Filter(CAMERA, CAMERA)

    def _start(self) -> None:
        features = sum(len(births) for _, births in self._births)
        self._filter = Filter(CAMERA, CAMERA, settings=FilterSettings({"map.max_features": features}))
        for (t, ids, uv), births in self._births:
            self._filter.predict(t)
            new = np.full(len(births), -1)
            depths = DepthMeasurement(new, births[:, :2], births[:, 2], births[:, 3])
            self._filter.update(ids, ids, uv, depths=depths)
        self._next = 0

    @property
    def frames(self) -> int:
        """Number of frames after the births."""
        return len(self._frames)

    def run(self) -> int:
        """Nanoseconds of the next frame."""
        if self._next == len(self._frames):
            self._start()
        t, ids, uv = self._frames[self._next]
        self._next += 1
        start = time.perf_counter_ns()
        self._filter.predict(t)
        self._filter.predict_pixels()
        self._filter.update(ids, ids, uv)
        return time.perf_counter_ns() - start


def main() -> None:
    """See the module's page."""
    replay = Replay(sys.stdin.readline().strip())
    times = [replay.run() for _ in range(int(sys.argv[1]) * replay.frames)]
    sys.stdout.write("|".join(map(str, times)) + "\n")


if __name__ == "__main__":
    main()

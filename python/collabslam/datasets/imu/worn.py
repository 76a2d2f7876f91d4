"""Views of worn cameras whose own gyroscopes tell how they turned (METHOD section 6)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from collabslam._core import GYRO_GAP
from collabslam.datasets.imu.beside import Whose, WornGyroGiven, imu_log
from collabslam.datasets.ordered import DiskRecording
from collabslam.datasets.recorded_worn import RecordedWorn
from collabslam.errors import DataError
from collabslam.types import Array, ImuLog, WornView

FOLDER, OF_PERSON = "imu1", "imu"
"""Where our own layout has the gyroscope of its only worn camera, and of a person's: ``worn/NAME/imu``."""


def place_of(path: Path, name: str) -> Path:
    """The folder of a worn camera's gyroscope in our own layout."""
    return path / "worn" / name / OF_PERSON if name else path / FOLDER


def with_worn_rates(
    recording: DiskRecording, path: Path, given: WornGyroGiven | None, topics: Mapping[str, str]
) -> DiskRecording:
    """The recording with the rates of its worn cameras' gyroscopes in its views, and all samples beside it.

    Raises
    ------
    DataError
        If a gyroscope that is there or given cannot be used, or one is given and the recording has not one
        worn camera.
    """
    if given is not None and len(recording.worn) != 1:
        raise DataError(
            f"A gyroscope of Cf is given, and {path} holds the views of {len(recording.worn)} worn cameras; "
            "of several persons each one's belongs into worn/NAME/imu of our own layout."
        )
    worn, logs = dict(recording.worn), dict[str, ImuLog]()
    for name, one in recording.worn.items():
        times = recording.times[sorted(one.views)]
        whose = Whose.cf(place_of(path, name))
        log = imu_log(path, times, one.camera, given, whose, topics) if times.size else None
        if log is not None:
            worn[name], logs[name] = _with_rates(one, recording.times, log), log
    return replace(recording, worn=worn, worn_imu=logs) if logs else recording


def rate_at(log: ImuLog, t: float) -> Array | None:
    """Angular velocity (3,) along the camera's axes at a time of the frames, rad/s; None in a gap."""
    at = t - log.sensor.time_offset
    after = int(np.searchsorted(log.times, at))
    pair = np.clip([after - 1, after], 0, len(log) - 1)
    near = log.times[pair]
    if not near[0] <= at <= near[1] or near[1] - near[0] > GYRO_GAP:
        return None
    along = np.array([np.interp(at, near, axis) for axis in log.rates[pair].T])
    return np.asarray(log.sensor.r_ci @ along)


def _with_rates(worn: RecordedWorn, times: Array, log: ImuLog) -> RecordedWorn:
    def read(before: Callable[[], WornView | None], t: float) -> WornView | None:
        view = before()
        return None if view is None else replace(view, rate=rate_at(log, t if view.t is None else view.t))

    views = {i: partial(read, before, float(times[i])) for i, before in worn.views.items()}
    return replace(worn, views=views)

"""A gyroscope beside a tiny recording: its samples as arrays and as lines."""

from __future__ import annotations

import numpy as np
from helpers.clip import Clip

from collabslam.datasets.wrapped import WrappedRecording
from collabslam.geometry import rotation_exp, rotation_log
from collabslam.types import Frame, Image, Imu, ImuLog

RATE = 200.0


def samples(first: float, seconds: float = 0.4, rate: float = RATE) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and rates of a sensor that turns to and fro, no two alike."""
    times = first + np.arange(round(seconds * rate)) / rate
    t = times - first
    noise = 1e-3 * np.random.default_rng(3).standard_normal((len(times), 3))
    return times, np.stack(
        [0.4 * np.sin(9 * t), 0.3 * np.cos(7 * t), 0.2 * np.sin(5 * t + 1)], axis=1
    ) + noise


def lines(stamps: list[str], *columns: np.ndarray) -> str:
    """A CSV of stamps and columns."""
    rows = np.concatenate(columns, axis=1)
    return "".join(
        f"{stamp},{','.join(repr(float(x)) for x in row)}\n" for stamp, row in zip(stamps, rows, strict=True)
    )


BIAS = np.array([0.02, -0.01, 0.03])
R_CI = rotation_exp([0.4, -1.3, 0.2])


def of_clip(clip: Clip, *, late: float = 0.0, sensor: Imu | None = None) -> ImuLog:
    """Rates with a bias at 200 Hz of the demo's first seconds, whose stamps are so much ``late``."""
    times = np.arange(-0.2, clip.frames[-1].t + 0.3, 1.0 / RATE)
    half = 0.5 / RATE
    turns = [clip.recording.robot(t - half)[:3, :3].T @ clip.recording.robot(t + half)[:3, :3] for t in times]
    rates = np.array([R_CI.T @ rotation_log(turn) * RATE for turn in turns]) + BIAS
    return ImuLog(times + late, rates, None, sensor or Imu(R_CI, time_offset=-late))


class Turned(WrappedRecording):
    """The demo's first frames with a gyroscope."""

    def __init__(self, clip: Clip, log: ImuLog | None) -> None:
        super().__init__(clip.recording)
        count = len(clip.frames)
        self.times, self.truth = self.times[:count], clip.recording.truth[:count]
        self.imu, self._frames = log, clip.frames

    def __len__(self) -> int:
        return len(self._frames)

    def image(self, i: int) -> Image:
        return self._frames[i].image

    def frame(self, i: int) -> Frame:
        return self._frames[i]

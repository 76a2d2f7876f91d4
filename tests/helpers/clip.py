"""The first frames of the demo, played once for all tests, and what is asked of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import DataError
from collabslam.evaluation.record import RunRecord
from collabslam.frontend.detect import Corners
from collabslam.settings.frontend import DetectSettings
from collabslam.simulation import SimulatedRecording
from collabslam.slam.view import View
from collabslam.types import Frame, Image, WornView

FRAMES = 15
GLOBAL_SHUTTER = {"filter.calibration.readout": 0.0, "filter.calibration.readout_sd": 0.0}
"""Settings that tell what the demo's shutter is, for what else would hang on how well the filter knows it."""


@dataclass(frozen=True)
class Clip:
    """The first frames of the demo recording."""

    recording: SimulatedRecording
    frames: list[Frame]


class Short(WrappedRecording):
    """The first frames of the clip as a recording; frame ``ends`` cannot be read."""

    def __init__(self, clip: Clip, frames: int = FRAMES, ends: int | None = None) -> None:
        super().__init__(clip.recording)
        self.times, self.truth = self.times[:frames], clip.recording.truth[:frames]
        self._frames, self._ends = clip.frames[:frames], ends

    def __len__(self) -> int:
        return len(self._frames)

    def image(self, i: int) -> Image:
        return self._frames[i].image

    def frame(self, i: int) -> Frame:
        if i == self._ends:
            raise DataError("The disk is gone.")
        return self._frames[i]


def make_view(image: Image) -> View:
    """A frame of which nothing but its image counts."""
    corners = Corners(image, DetectSettings(), 8)
    return View(0.0, image, None, None, corners, started=True, lost=False)


def stretched_later(views: Sequence[WornView], k: int) -> list[WornView]:
    """The views of the k-th frame: their T_CF is two and a half times as long from the eighth on."""
    stretch = np.ones((4, 4))
    stretch[:3, 3] = 1.0 if k < 8 else 2.5
    return [replace(view, t_cf=stretch * view.t_cf) for view in views]


def length_share(record: RunRecord, truth: np.ndarray) -> float:
    """Length of the way from the first frame to the last, as a share of the true one."""
    first, last = record.poses[0], record.poses[-1]
    true = np.linalg.norm(truth[len(record.poses) - 1][:3, 3] - truth[0][:3, 3])
    return float(np.linalg.norm(last[:3, 3] - first[:3, 3]) / true)

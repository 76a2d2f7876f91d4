"""What several test modules need: the first frames of the demo, played once, and Ctrl-C as in a terminal."""

from __future__ import annotations

import signal
from dataclasses import dataclass, replace

import pytest

from collabslam.demo import DemoRecording, corridor_recording
from collabslam.frontend.detect import Corners
from collabslam.settings.frontend import DetectSettings
from collabslam.slam.view import View
from collabslam.types import Frame, Image, WornView

FRAMES = 15
GLOBAL_SHUTTER = {"filter.calibration.readout": 0.0, "filter.calibration.readout_sd": 0.0}
"""Settings that tell what the demo's shutter is, for what else would hang on how well the filter knows it."""


@dataclass(frozen=True)
class Clip:
    """The first frames of the demo recording."""

    recording: DemoRecording
    frames: list[Frame]


@pytest.fixture(scope="session", autouse=True)
def ctrl_c() -> None:
    """A shell starts what runs in the background with SIGINT ignored, and children inherit that."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def clip() -> Clip:
    recording = corridor_recording()
    return Clip(recording, [recording.frame(i) for i in range(FRAMES)])


def make_view(image: Image) -> View:
    """A frame of which nothing but its image counts."""
    corners = Corners(image, DetectSettings(), 8)
    return View(0.0, image, None, None, corners, started=True, lost=False)


def stretched_later(worn: WornView | None, k: int) -> WornView | None:
    """The view of the k-th frame: its T_CF is two and a half times as long from the eighth on."""
    if worn is None or k < 8:
        return worn
    t_cf = worn.t_cf.copy()
    t_cf[:3, 3] *= 2.5
    return replace(worn, t_cf=t_cf)

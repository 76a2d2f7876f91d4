"""What several test modules need: the first frames of the demo, played once."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from collabslam.demo import DemoRecording, corridor_recording
from collabslam.types import Frame

FRAMES = 15


@dataclass(frozen=True)
class Clip:
    """The first frames of the demo recording."""

    recording: DemoRecording
    frames: list[Frame]


@pytest.fixture(scope="session")
def clip() -> Clip:
    recording = corridor_recording()
    return Clip(recording, [recording.frame(i) for i in range(FRAMES)])

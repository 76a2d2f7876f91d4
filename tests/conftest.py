"""What several test modules need: the first frames of the demo, played once, and Ctrl-C as in a terminal."""

from __future__ import annotations

import signal

import pytest
from helpers.clip import FRAMES, Clip

from collabslam.simulation import corridor_recording


@pytest.fixture(scope="session", autouse=True)
def ctrl_c() -> None:
    """A shell starts what runs in the background with SIGINT ignored, and children inherit that."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def clip() -> Clip:
    recording = corridor_recording()
    return Clip(recording, [recording.frame(i) for i in range(FRAMES)])

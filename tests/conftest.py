"""What several test modules need: the first frames of the demo, played once, and Ctrl-C as in a terminal."""

from __future__ import annotations

import signal

import pytest
from helpers.clip import FRAMES, Clip

from collabslam.simulation import corridor_recording


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests go first, so that processes that share the tests end together."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session", autouse=True)
def ctrl_c() -> None:
    """A shell starts what runs in the background with SIGINT ignored, and children inherit that."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def clip() -> Clip:
    recording = corridor_recording()
    return Clip(recording, [recording.frame(i) for i in range(FRAMES)])

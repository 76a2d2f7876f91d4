"""What several test modules need: the first frames of the demo, played once, and Ctrl-C as in a terminal."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
from helpers import drawn
from helpers.clip import FRAMES, Clip

from collabslam.simulation import corridor_recording
from collabslam.simulation.renderer import Renderer

LONGEST = (
    "test_documentation.py",
    "test_check_calib.py",
    "test_demo_of_docs.py",
    "test_clocks.py",
    "test_calibrate_person.py",
    "test_experiments.py",
    "test_hostile_files.py",
    "test_reproduce.py",
    "test_attacks.py",
    "test_relocalise.py",
    "test_end_to_end.py",
    "test_readers.py",
)
"""Files that take longer than others, the longest first."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files go first, then those with slow tests: processes that share the tests end together."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    rank = {name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: (rank.get(item.path.name, len(rank)), item.path not in slow))


@pytest.fixture(scope="session", autouse=True)
def ctrl_c() -> None:
    """A shell starts what runs in the background with SIGINT ignored, and children inherit that."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def drawn_once() -> None:
    """Most tests are of what is done with pictures; `drawn_anew` is for those of how they are drawn."""
    Renderer.render = drawn.kept  # type: ignore[method-assign]


@pytest.fixture(scope="module")
def drawn_anew(drawn_once: None) -> Iterator[None]:
    """Every picture is drawn when it is asked for, as the product does."""
    Renderer.render = drawn.draw  # type: ignore[method-assign]
    yield
    Renderer.render = drawn.kept  # type: ignore[method-assign]


@pytest.fixture(scope="session")
def clip() -> Clip:
    recording = corridor_recording()
    return Clip(recording, [recording.frame(i) for i in range(FRAMES)])

"""Names are data: a terminal is given no commands of theirs, and the system no zero bytes."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import collabslam
from collabslam import CollabslamError, InputError, Slam
from collabslam.cli.main import main, printable
from collabslam.datasets import load_camera


@pytest.mark.parametrize("name", ["a\x1b[2J.png", "a\rb", "\x9b31m", "a\x07", "\u202egnp.a"])
def test_an_error_holds_no_commands(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["info", name]) == 2
    said = capfd.readouterr().err
    assert said.replace("\n", "").isprintable()
    assert said.count("error: ") == 1


def test_what_can_be_printed_stays() -> None:
    assert printable("Die Datei Größe.png is 漢字\nsecond") == "Die Datei Größe.png is 漢字\nsecond"
    assert printable("a\x1b[2J") == "a\\x1b[2J"


@pytest.mark.parametrize("read", [collabslam.open_recording, load_camera, Slam.load])
def test_no_file_has_a_zero_byte_in_its_name(read: Callable[[str], object]) -> None:
    with pytest.raises(CollabslamError):
        read("a\0b")


@pytest.mark.parametrize("numbers", [(0, 99), (-1, 0), (99, 99), ("a", 0), (None, 0), (2**70, 0)])
def test_there_is_no_such_submap(numbers: tuple[int, int]) -> None:
    camera = collabslam.Camera("pinhole", 64, 48, (50.0, 50.0, 32.0, 24.0))
    with pytest.raises(InputError, match="no submap"):
        Slam(camera, mode="mono", start="scale-free").between_submaps(*numbers)

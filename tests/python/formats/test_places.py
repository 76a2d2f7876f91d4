"""What is written goes where it was told, and nowhere else: no link is followed, no foreign file touched."""

from __future__ import annotations

import os
import stat
import threading
from pathlib import Path

import numpy as np
import pytest

from collabslam import Camera, DataError, RecordingWriter
from collabslam.datasets import open_recording
from collabslam.formats.files import LineFile, read_own_text, remove_parts, try_place, write_bytes
from collabslam.formats.partial_folder import ENDING, PartialFolder

CAMERA = Camera("pinhole", 64, 48, (50.0, 50.0, 32.0, 24.0))
GREY = np.zeros((48, 64), np.uint8)


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    path = tmp_path / "victim"
    path.write_text("mine")
    return path


def test_a_name_that_can_be_guessed_leads_nowhere(victim: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    for name in (f".a.txt.{os.getpid()}.part", ".a.txt.part", "a.txt"):
        (folder / name).symlink_to(victim)
    try_place(folder / "a.txt")
    write_bytes(folder / "a.txt", b"new")
    assert victim.read_text() == "mine"
    assert (folder / "a.txt").read_bytes() == b"new"
    assert not (folder / "a.txt").is_symlink()


def test_two_writers_of_one_file_do_not_meet(tmp_path: Path) -> None:
    """One process, many threads: each whole content is one of them, and nothing is left beside it."""
    path, contents = tmp_path / "a.bin", [bytes([k]) * 100_000 for k in range(8)]
    threads = [threading.Thread(target=write_bytes, args=(path, data)) for data in contents * 8]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert path.read_bytes() in contents
    assert list(tmp_path.iterdir()) == [path]


def test_the_longest_name_can_be_written(tmp_path: Path) -> None:
    path = tmp_path / ("a" * 251 + ".txt")
    write_bytes(path, b"x")
    assert path.read_bytes() == b"x"


def test_modes_are_those_of_the_process(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_bytes(tmp_path / "open", b"x")
        write_bytes(tmp_path / "private", b"x", private=True)
    finally:
        os.umask(before)
    modes = {p.name: stat.S_IMODE(p.stat().st_mode) for p in tmp_path.iterdir()}
    assert modes == {"open": 0o640, "private": 0o600}


def test_parts_of_a_name_with_a_pattern_are_its_own(tmp_path: Path) -> None:
    for name in (".a[bc]*.1.part", ".ab.1.part", ".other.1.part"):
        (tmp_path / name).write_text("x")
    remove_parts(tmp_path, ["a[bc]*"])
    assert sorted(p.name for p in tmp_path.iterdir()) == [".ab.1.part", ".other.1.part"]


def test_lines_go_through_no_link_and_into_no_pipe(victim: Path, tmp_path: Path) -> None:
    (tmp_path / "frames.csv").symlink_to(victim)
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name in ("frames.csv", "pipe", "folder", "gone"):
        with pytest.raises(DataError):
            LineFile(tmp_path / name)
    assert victim.read_text() == "mine"


@pytest.mark.parametrize("content", [b"\xff\xfe", b"a\xe9b"])
def test_what_is_no_text_is_told(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "frames.csv").write_bytes(content)
    for name in ("frames.csv", "gone", "."):
        with pytest.raises(DataError):
            read_own_text(tmp_path / name)


def test_a_recording_is_written_through_no_link(victim: Path, tmp_path: Path) -> None:
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    (theirs / "photo").write_text("mine")
    (tmp_path / ".walk.partial").symlink_to(theirs)
    with RecordingWriter(tmp_path / "walk", CAMERA) as writer:
        writer.add(0.0, GREY)
    assert [p.name for p in theirs.iterdir()] == ["photo"]
    assert len(open_recording(tmp_path / "walk")) == 1


def test_a_folder_of_a_guessed_name_is_not_removed(tmp_path: Path) -> None:
    mine = tmp_path / ".walk.partial"
    mine.mkdir()
    (mine / "photo").write_text("mine")
    with RecordingWriter(tmp_path / "walk", CAMERA) as writer:
        writer.add(0.0, GREY)
    assert (mine / "photo").read_text() == "mine"


def test_what_killed_writers_left_goes_and_what_others_write_stays(tmp_path: Path) -> None:
    place = tmp_path / "walk"
    left = tmp_path / f".walk.{'0' * 16}{ENDING}"
    left.mkdir()
    (left / "half").write_text("x")
    first, second = PartialFolder(place), PartialFolder(place)
    assert not left.exists()
    assert first.path.is_dir()
    assert second.path.is_dir()
    (second.path / "data").write_text("second")
    second.take_place()
    assert (place / "data").read_text() == "second"
    first.discard()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["walk"]

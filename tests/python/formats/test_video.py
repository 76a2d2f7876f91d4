"""Videos: a process of their own gives the pixels that OpenCV gives, and is all that a hostile one ends."""

from __future__ import annotations

import signal
import struct
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from collabslam.errors import DataError
from collabslam.formats.video import VideoFile
from collabslam.types import Image

WIDTH, HEIGHT, FRAMES = 64, 48, 6


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("film") / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20.0, (WIDTH, HEIGHT))
    noise = np.random.default_rng(0).integers(0, 255, (FRAMES, HEIGHT, WIDTH, 3), np.uint8)
    for image in noise:
        writer.write(image)
    writer.release()
    return path


def opencv(path: Path) -> list[Image]:
    capture, images = cv2.VideoCapture(str(path)), []
    while (found := capture.read())[0]:
        images.append(np.asarray(cv2.cvtColor(found[1], cv2.COLOR_BGR2GRAY), np.uint8))
    return images


def test_frames_are_those_of_opencv_in_any_order(film: Path) -> None:
    video, images = VideoFile(film), opencv(film)
    assert (video.width, video.height, video.rate) == (WIDTH, HEIGHT, 20.0)
    np.testing.assert_allclose(video.stamps(), np.arange(FRAMES) / 20.0, atol=1e-9)
    for i in (0, 1, 4, 2, 2, 5):
        np.testing.assert_array_equal(video.read(i), images[i])
    assert video.read(FRAMES) is None
    np.testing.assert_array_equal(video.read(0), images[0])


@pytest.mark.parametrize(
    "text",
    [
        "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfilm.avi\n#EXT-X-ENDLIST\n",
        "ffconcat version 1.0\nfile film.avi\n",
        "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 5004 RTP/AVP 96\n",
        "",
    ],
)
def test_what_names_other_films_is_none(film: Path, text: str) -> None:
    path = film.parent / "list.mp4"
    path.write_text(text)
    with pytest.raises(DataError, match=r"list.mp4 cannot be decoded"):
        VideoFile(path)


@pytest.mark.parametrize("side", [8193, 60000])
def test_films_of_larger_frames_than_the_limit_are_refused(film: Path, tmp_path: Path, side: int) -> None:
    """The container and each of its pictures promise them, as a decoder takes whichever it likes."""
    data = film.read_bytes().replace(struct.pack("<II", WIDTH, HEIGHT), struct.pack("<II", side, side))
    data = data.replace(struct.pack(">HH", HEIGHT, WIDTH), struct.pack(">HH", side, side))
    path = tmp_path / "large.avi"
    path.write_bytes(data)
    with pytest.raises(DataError, match=r"large.avi cannot be decoded"):
        VideoFile(path)


LIMITED = """
from collabslam.formats import video_worker as w
w.limit_memory(w.ROOM)
w.limit_time(1)
{}
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have other limits")
@pytest.mark.parametrize(
    ("what", "status"), [("bytearray(w.ROOM + (1 << 28))", 1), ("while True: pass", -signal.SIGXCPU)]
)
def test_a_film_has_limits_of_memory_and_time(what: str, status: int) -> None:
    done = subprocess.run([sys.executable, "-c", LIMITED.format(what)], capture_output=True)
    assert done.returncode == status, done.stderr


def test_a_film_that_ends_its_process_is_told_and_others_go_on(film: Path) -> None:
    video, other = VideoFile(film), VideoFile(film)
    assert video._worker is not None
    video._worker.kill()
    with pytest.raises(DataError, match="more memory or time than a video may"):
        video.read(0)
    assert other.read(0) is not None


def test_a_read_that_is_broken_off_leaves_no_half_answer(film: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    video, images = VideoFile(film), opencv(film)
    assert video._worker is not None

    def interrupted(*_: object) -> bytes:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(video._worker, "_read", interrupted)
        with pytest.raises(KeyboardInterrupt):
            video.read(3)
    np.testing.assert_array_equal(video.read(1), images[1])


def test_what_lies_beside_a_film_is_not_run(
    film: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever is given a folder looks into it from there; Python would take modules from it."""
    for name in ("cv2.py", "numpy.py", "struct.py", "collabslam.py"):
        (tmp_path / name).write_text(f"open({str(tmp_path / 'stolen')!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    assert VideoFile(film).read(0) is not None
    assert not (tmp_path / "stolen").exists()

"""Files that promise more than they hold, wait for ever, or are not what they are called."""

from __future__ import annotations

import bz2
import os
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.waiting import LONGEST

from collabslam._core import Camera
from collabslam.datasets import images, load_camera, open_recording
from collabslam.datasets.gate import data_lines
from collabslam.datasets.image_header import read_header
from collabslam.datasets.images import decode, decode_grey, read_grey
from collabslam.datasets.ros import bounded
from collabslam.datasets.ros.bag import Bag
from collabslam.datasets.ros.writer import write_bag
from collabslam.errors import DataError
from collabslam.formats.files import read_bytes
from collabslam.runs.run_folder import read_frames
from collabslam.settings.table import Settings
from collabslam.simulation import corridor_recording
from collabslam.types import Image
from collabslam_lab.reliability.attacks.bags import COMPUTED, spoil_database
from collabslam_lab.reliability.attacks.image_bombs import HIDDEN, HUGE, JPEG, OTHERWISE, segment

GIF = b"GIF89a" + struct.pack("<HH", 40000, 40000) + b"\x80\0\0\0\0\0\xff\xff\xff," + b"\0" * 4
CAMERA = Camera("pinhole", 32, 24, (30.0, 30.0, 15.5, 11.5))


def picture(depth: int = 8) -> Image:
    grey = np.random.default_rng(depth).integers(0, 1 << depth, (24, 32))
    return grey.astype(np.uint8 if depth == 8 else np.uint16)


def encoded(suffix: str, image: np.ndarray) -> bytes:
    done, data = cv2.imencode(suffix, image)
    assert done
    return bytes(data)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".pgm", ".ppm", ".bmp", ".tif"])
def test_the_header_says_what_the_decoder_finds(suffix: str) -> None:
    image = picture() if suffix != ".ppm" else np.dstack([picture()] * 3)
    data = encoded(suffix, image)
    header = read_header(data)
    assert header is not None
    assert (header.width, header.height, header.bits) == (32, 24, 8)
    assert decode(data, "it").shape == (24, 32)


@pytest.mark.parametrize(
    "data",
    [GIF, b"RIFF\x10\0\0\0WEBPVP8 ", b"\x76\x2f\x31\x01" + b"\0" * 60,
     b"#?RADIANCE\n\n-Y 9999 +X 9999\n", b"\0\0\0\x0cjP  \r\n\x87\n",
     b"P7\nWIDTH 9000\nHEIGHT 9000\nDEPTH 1\nMAXVAL 255\nENDHDR\n", b"Pf\n9 9\n-1\n"],
    ids=["gif", "webp", "exr", "hdr", "jpeg2000", "pam", "pfm"],
)  # fmt: skip
def test_other_formats_never_reach_a_decoder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, data: bytes
) -> None:
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("was decoded"))
    path = tmp_path / "frame.png"
    path.write_bytes(data)
    with pytest.raises(DataError, match=r"which is not read \(PNG"):
        decode_grey(path)


def test_another_size_is_refused_before_it_is_decoded(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    data = encoded(".png", np.zeros((3000, 3000), np.uint8))
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("was decoded"))
    (tmp_path / "frame.png").write_bytes(data)
    with pytest.raises(DataError, match="is 3000x3000 but its camera is calibrated for 32x24"):
        read_grey(tmp_path / "frame.png", CAMERA)


def test_no_header_may_promise_a_huge_image(monkeypatch: pytest.MonkeyPatch) -> None:
    data = bytearray(encoded(".bmp", picture()))
    data[18:26] = struct.pack("<ii", 60000, 60000)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("was decoded"))
    with pytest.raises(DataError, match="cut short or broken, moves"):
        decode(bytes(data), "it")


@pytest.mark.parametrize("name", list(HIDDEN))
def test_a_jpeg_is_read_as_its_decoder_does_or_not_at_all(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("was decoded"))
    with pytest.raises(DataError, match=r"cut short or broken, moves|not an image that is read"):
        decode(HIDDEN[name], "it")


@pytest.mark.parametrize(
    "data",
    [
        JPEG + b"trailer" * 1000,
        JPEG[:2] + b"\xff\xff\xff" + JPEG[3:],
        JPEG[:2] + segment(0xE1, HUGE) + segment(0xEF, b"x") + segment(0xFE, b"a comment") + JPEG[2:],
        JPEG + JPEG,
    ],
    ids=["trailer", "filled", "segments", "two pictures"],
)
def test_a_jpeg_as_phones_write_it_is_read(data: bytes) -> None:
    np.testing.assert_array_equal(decode(data, "it"), decode(JPEG, "it"))


@pytest.mark.parametrize("name", list(OTHERWISE))
def test_what_decoders_read_otherwise_is_not_decoded(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("was decoded"))
    with pytest.raises(DataError, match="cut short or broken, moves"):
        decode(OTHERWISE[name], "it")


def test_twelve_bits_in_sixteen_keep_their_brightness(tmp_path: Path) -> None:
    deep = [(picture(12) >> shade).astype(np.uint16) for shade in range(4)]
    for k, image in enumerate(deep):
        (tmp_path / f"{k}.png").write_bytes(encoded(".png", image))
    for k, image in enumerate(deep):  # all of them alike, however dark each is
        np.testing.assert_array_equal(decode_grey(tmp_path / f"{k}.png"), (image >> 4).astype(np.uint8))


def test_sixteen_bits_and_stated_ones(tmp_path: Path) -> None:
    full = picture(16)
    np.testing.assert_array_equal(decode(encoded(".png", full), "it"), (full >> 8).astype(np.uint8))
    ten = picture(10)
    pgm = b"P5\n32 24\n1023\n" + ten.astype(">u2").tobytes()
    np.testing.assert_array_equal(decode(pgm, "it"), (ten >> 2).astype(np.uint8))
    for k in range(130):
        (tmp_path / f"{k:03}.png").write_bytes(encoded(".png", full if k == 1 else ten))
    images.used_range.cache_clear()
    np.testing.assert_array_equal(decode_grey(tmp_path / "002.png"), (ten >> 2).astype(np.uint8))
    white = np.minimum(full >> 2, 255).astype(np.uint8)  # one of many does not darken all others
    np.testing.assert_array_equal(decode_grey(tmp_path / "001.png"), white)


PIPES: list[tuple[str, Callable[[Path], object]]] = [
    ("image", decode_grey),
    ("calibration", load_camera),
    ("poses", data_lines),
    ("settings", Settings.load),
    ("frames", read_frames),
    ("bytes", read_bytes),
]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
@pytest.mark.parametrize(("name", "read"), PIPES, ids=[name for name, _ in PIPES])
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_only_regular_files_are_opened(
    tmp_path: Path, name: str, read: Callable[[Path], object], kind: str
) -> None:
    path = tmp_path / "file"
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    seen: list[BaseException] = []

    def attempt() -> None:
        try:
            read(path)
        except Exception as error:
            seen.append(error)

    reader = threading.Thread(target=attempt, daemon=True)
    reader.start()
    reader.join(LONGEST)
    assert seen, "it waits"
    assert isinstance(seen[0], DataError)
    assert "regular file" in str(seen[0])


@pytest.mark.parametrize(("name", "read"), PIPES, ids=[name for name, _ in PIPES])
def test_a_file_may_not_be_endless(tmp_path: Path, name: str, read: Callable[[Path], object]) -> None:
    path = tmp_path / "file"
    path.touch()
    os.truncate(path, 5_000_000_000)  # it takes no room on the disk
    with pytest.raises(DataError, match="has 4768 MB, more than"):
        read(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_among_the_images(tmp_path: Path) -> None:
    for k in range(3):
        (tmp_path / f"{k}.png").write_bytes(encoded(".png", picture()))
    os.mkfifo(tmp_path / "7.png")
    camera = tmp_path / "camera.yaml"
    camera.write_text("resolution: [32, 24]\nintrinsics: [30, 30, 15.5, 11.5]\nrate: 10\n")
    with pytest.raises(DataError, match=r"7\.png is not a regular file"):
        open_recording(tmp_path, camera=camera)


def test_decompression_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    data = bytes(3_000_000)
    packed = bz2.compress(data[:1_000_000]) + bz2.compress(data[1_000_000:])
    assert bounded.decompressed(packed, bz2.BZ2Decompressor) == data
    with pytest.raises(DataError, match="cut short"):
        bounded.decompressed(packed[:-5], bz2.BZ2Decompressor)
    monkeypatch.setattr(bounded, "ALWAYS", 1 << 20)
    with pytest.raises(DataError, match="hold more than 1 MB"):
        bounded.decompressed(packed, bz2.BZ2Decompressor)


def test_the_command_lines_decoder_keeps_the_limit_of_pixels_itself() -> None:
    """OpenCV reads it once, when it is loaded: in a process of its own, as a command is one."""
    program = (
        "import sys\n"
        "from collabslam.cli.main import main\n"
        "assert 'cv2' not in sys.modules\n"
        "assert main(['settings', 'docs']) == 0\n"
        "import cv2, numpy as np\n"
        "for wide in (1 << 14, (1 << 14) + 1):\n"
        "    data = np.frombuffer(b'P5 %d 8192 255 ' % wide + bytes(99), np.uint8)\n"
        "    try:\n"
        "        cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)\n"
        "        print('taken')\n"
        "    except cv2.error as error:\n"
        "        print('refused', 'MAX_IMAGE_PIXELS' in str(error))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env={k: v for k, v in os.environ.items() if k != "OPENCV_IO_MAX_IMAGE_PIXELS"},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-2:] == ["taken", "refused True"]


def test_many_passes_over_a_large_picture_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    data = encoded(".jpg", picture())
    assert decode(data, "it").shape == (24, 32)
    monkeypatch.setattr(images, "MOST_PASSED", 32 * 24 - 1)
    with pytest.raises(DataError, match="cut short or broken, moves"):
        decode(data, "it")


@pytest.mark.parametrize("row", COMPUTED, ids=lambda row: row[0])
def test_a_database_computes_nothing_that_a_bag_asks_for(
    row: tuple[str, str, tuple[str, ...]], tmp_path: Path
) -> None:
    write_bag(corridor_recording(0, length_m=0.3), tmp_path / "bag", storage="sqlite3")
    with Bag(tmp_path / "bag") as bag:
        assert len(list(bag.messages("/t_cf"))) > 0
    spoil_database(tmp_path / "bag" / "bag.db3", row[2])
    with pytest.raises(DataError, match=r"not authorized|computed"):
        Bag(tmp_path / "bag")

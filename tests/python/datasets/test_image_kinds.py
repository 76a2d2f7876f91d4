"""Pictures of kinds that are not read are called by their names, alone, in a folder and as a recording."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from collabslam._core import Camera
from collabslam.cli import main as cli
from collabslam.datasets.image_kinds import FOREIGN, kind_of, ours
from collabslam.datasets.images import decode, decode_deep, list_images
from collabslam.errors import DataError

IMAGE = np.random.default_rng(0).integers(0, 255, (48, 64), np.uint8)
CAMERA = "model: pinhole\nwidth: 64\nheight: 48\nintrinsics: [40, 40, 31.5, 23.5]\nrate: 10\n"


def box(*brands: bytes) -> bytes:
    """The first box of an ISO file: its major brand, and the others."""
    rest = b"".join(brands[1:])
    return (16 + len(rest)).to_bytes(4, "big") + b"ftyp" + brands[0] + b"\0\0\0\0" + rest + b"\0" * 80


STARTS = [
    (b"RIFF\x10\0\0\0WEBPVP8 ", "a WebP image", "convert it to PNG"),
    (b"RIFF\x10\0\0\0AVI LIST", "a film", "give the film"),
    (box(b"heic", b"mif1", b"heic"), "a HEIC image, as iPhones make them", "Most Compatible"),
    (box(b"mif1", b"heic"), "a HEIC image", "heif-convert"),
    (box(b"mif1", b"avif", b"miaf"), "an AVIF image", "convert it to PNG"),
    (box(b"isom", b"mp41"), r"a film \(MP4 or MOV\)", "give the film"),
    (box(b"crx "), "a raw image of a camera", "develop it"),
    (b"GIF89a" + b"\0" * 40, "a GIF image", "convert it to PNG"),
    (b"\xff\x4f\xff\x51\0", "a JPEG 2000 image", "convert it to PNG"),
    (b"\xff\x0a\0\0", "a JPEG XL image", "convert it to PNG"),
    (b"II+\0\x08\0", "a BigTIFF", "convert it to PNG"),
    (b"v/1\x01\0\0", "an OpenEXR image", "convert it to PNG"),
    (b"\x93NUMPY\x01\0v\0{}", "an array of NumPy", "cv2.imwrite"),
    (b"version https://git-lfs.github.com/spec/v1\n", "a pointer of Git LFS", "git lfs pull"),
    (b"\xef\xbb\xbf\n<!DOCTYPE HTML><html>404", "a web page", "download it again"),
    (b"PK\x03\x04\x14", "a ZIP archive", "unpack it"),
]


@pytest.mark.parametrize(("data", "name", "remedy"), STARTS, ids=[s[1] + str(len(s[0])) for s in STARTS])
def test_a_kind_is_named_with_what_to_do(tmp_path: Path, data: bytes, name: str, remedy: str) -> None:
    with pytest.raises(DataError, match=rf"0\.png is {name}.*which is not read.*{remedy}"):
        decode(data, "0.png")
    (tmp_path / "depth.png").write_bytes(data)
    with pytest.raises(DataError, match=rf"depth\.png is {name}.*16-bit PNG"):
        decode_deep(tmp_path / "depth.png", Camera("pinhole", 64, 48, (40.0, 40.0, 31.5, 23.5)))
    for cut in range(len(data)):
        kind_of(data[:cut])  # whatever comes, it is a name or none


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif", ".pgm"])
def test_images_that_are_read_are_no_other_kind(suffix: str) -> None:
    data = bytes(cv2.imencode(suffix, IMAGE)[1])
    assert kind_of(data) is None
    assert ours(data) is not None
    with pytest.raises(DataError, match="cut short or broken"):
        decode(data[: len(data) // 2] if suffix != ".tif" else data[:60], f"0{suffix}")
    with pytest.raises(DataError, match="is empty"):
        decode(b"", f"0{suffix}")
    with pytest.raises(DataError, match="not an image that is read"):
        decode(b"\x01\x02\x03", f"0{suffix}")


def test_what_opencv_writes_as_webp_is_named_in_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bytes(cv2.imencode(".webp", IMAGE)[1])
    (tmp_path / "camera.yaml").write_text(CAMERA)
    folder = tmp_path / "walk"
    folder.mkdir()
    for k in range(4):
        (folder / f"{k:03d}.webp").write_bytes(data)
    for command in (
        ["info", str(folder)],
        ["info", str(folder), "--camera", str(tmp_path / "camera.yaml")],
        ["run", str(folder), "--camera", str(tmp_path / "camera.yaml"), "--out", str(tmp_path / "out")],
        ["init", str(folder), "--board", "7x5:0.03", "--out", str(tmp_path / "new")],
    ):
        assert cli.main(command) == 2
        assert "images that are not read (4 WebP); convert them to PNG or JPEG" in capsys.readouterr().err


def test_a_few_beside_those_that_are_read_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "camera.yaml").write_text(CAMERA)
    folder = tmp_path / "walk"
    folder.mkdir()
    for k in range(3):
        cv2.imwrite(str(folder / f"{k}.png"), IMAGE)
        (folder / f"{k}.dng").write_bytes(b"II*\0")  # a raw image beside each
    assert cli.main(["info", str(folder), "--camera", str(tmp_path / "camera.yaml")]) == 0
    assert "3 raw images, which are not read" in capsys.readouterr().out
    (folder / "4.heic").write_bytes(box(b"heic"))  # which has no PNG: more are not read than are
    with pytest.raises(DataError, match=r"\(.*1 HEIC.*\) beside 3 that are"):
        list_images(folder)


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("one.png", bytes(cv2.imencode(".png", IMAGE)[1]), "is a PNG, not a recording; give the folder"),
        ("walk.gif", b"GIF89a" + b"\0" * 60, "is a GIF image, which is not read as a recording; convert"),
        ("walk.3gp", box(b"3gp4"), "rename it so that it ends in .mp4"),
        ("walk.zip", b"PK\x03\x04" + b"\0" * 60, "is a ZIP archive.*unpack it"),
    ],
)
def test_a_file_in_place_of_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, data: bytes, said: str
) -> None:
    (tmp_path / name).write_bytes(data)
    assert cli.main(["info", str(tmp_path / name)]) == 2
    assert re.search(said, capsys.readouterr().err)


def test_jpegs_by_their_other_names_are_read(tmp_path: Path) -> None:
    for suffix, kind in ((".jfif", ".jpg"), (".jpe", ".jpg"), (".pnm", ".pgm")):
        (tmp_path / f"0{suffix}").write_bytes(bytes(cv2.imencode(kind, IMAGE)[1]))
    assert len(list_images(tmp_path)) == 3
    assert not set(FOREIGN) & {".png", ".jfif", ".jpe", ".pnm"}


def test_images_one_folder_further_in_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "camera.yaml").write_text(CAMERA)
    (tmp_path / "walk" / "rgb").mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "walk" / "rgb" / "0.png"), IMAGE)
    assert cli.main(["info", str(tmp_path / "walk"), "--camera", str(tmp_path / "camera.yaml")]) == 2
    assert "Its folder rgb holds images: give one, as" in capsys.readouterr().err


def test_samples_that_are_no_whole_numbers_are_told(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.tif"), IMAGE.astype(np.float32) / 255.0)
    with pytest.raises(DataError, match="other samples than whole numbers of 8 or 16 bits"):
        decode((tmp_path / "0.tif").read_bytes(), "0.tif")


def test_depths_whose_bytes_are_exchanged_are_told(tmp_path: Path) -> None:
    """A floor that falls away, with holes, at 5000 counts a metre; and a wall of one depth."""
    camera = Camera("pinhole", 64, 48, (40.0, 40.0, 31.5, 23.5))
    floor = np.linspace(4000, 20000, 48)[:, None] + np.linspace(0, 900, 64) + np.zeros((48, 64))
    floor[10:20, 5:30] = 0
    wall = np.full((48, 64), 10000.0)
    for k, depths in enumerate((floor.astype(np.uint16), wall.astype(np.uint16))):
        cv2.imwrite(str(tmp_path / f"{k}.png"), depths)
        np.testing.assert_array_equal(decode_deep(tmp_path / f"{k}.png", camera), depths)
    cv2.imwrite(str(tmp_path / "swapped.png"), floor.astype(np.uint16).byteswap())
    with pytest.raises(DataError, match=r"bytes of each depth in .*swapped\.png are exchanged"):
        decode_deep(tmp_path / "swapped.png", camera)

"""The one place that reads images from disk."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.datasets.calibration import check_resolution
from collabslam.errors import DataError
from collabslam.types import Image

SMALL, DENSEST = 1 << 24, 1100
"""Pixels that any header may promise, and so many more for each byte of the file (DEFLATE's best is 1032)."""
IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".pgm", ".bmp", ".tif", ".tiff"})


def _is_cut_short(data: bytes) -> bool:
    """Whether a JPEG lacks its end marker; OpenCV 4 fills the missing part with grey and says nothing."""
    end = data.rstrip(b"\0")[-64:]  # Some cameras pad their files.
    return data.startswith(b"\xff\xd8") and b"\xff\xd9" not in end


def _claims_too_much(data: bytes) -> bool:
    """Whether a header promises more pixels than the file can hold; decoders take the memory first.

    Compressed formats store a byte for at most :data:`DENSEST` pixels or so.
    """
    if data.startswith(b"\x89PNG"):
        if not _png_is_whole(data):
            return True
        sides = [int.from_bytes(data[at : at + 4], "big") for at in (16, 20)]
    elif data.startswith(b"BM"):
        sides = [abs(int.from_bytes(data[at : at + 4], "little", signed=True)) for at in (18, 22)]
    elif data[:1] == b"P" and data[1:2] in b"123456":
        text = re.sub(rb"#[^\n]*", b" ", data[2:512]).split()
        sides = [int(word) if word.isdigit() and len(word) < 12 else 1 << 40 for word in text[:2]]
    else:
        sides = _jpeg_sides(data) if data.startswith(b"\xff\xd8") else [0]
    return math.prod(sides) > SMALL + DENSEST * len(data)


def _png_is_whole(data: bytes) -> bool:
    """Whether every chunk of a PNG, up to its end, is as long as it says."""
    at = 8
    while at + 12 <= len(data):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        at += 12 + length
        if kind == b"IEND":
            return at <= len(data)
    return False


def _jpeg_sides(data: bytes) -> list[int]:
    """Sides that the frame header of a JPEG names: the segments before it are skipped by their lengths."""
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            return [int.from_bytes(data[at + k : at + k + 2], "big") for k in (5, 7)]
        at += 1 if marker == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return [0]


def decode_grey(path: Path) -> Image:
    """Read an image file as (H, W) uint8 grey; colour is converted, EXIF orientation is ignored.

    Raises
    ------
    DataError
        Naming the file, if it is missing, empty, cut short or no image.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(
            f"The image {path} cannot be read ({error.strerror}); restore the file or take it out of the "
            "recording."
        ) from error
    return decode(data, str(path))


def decode(data: bytes, where: str) -> Image:
    """Decode the content of an image file (PNG, JPEG, ...) as (H, W) uint8 grey.

    Raises
    ------
    DataError
        Naming ``where``, if it is empty, cut short or no image.
    """
    image = None
    if data and not _is_cut_short(data) and not _claims_too_much(data):
        flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
        try:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
        except cv2.error:
            image = None
    if image is None:
        raise DataError(
            f"The image {where} is empty, cut short or not an image; copy it again from the source."
        )
    return np.asarray(image, dtype=np.uint8)


def read_grey(path: Path, camera: Camera) -> Image:
    """Read an image and check its size against the camera that took it.

    Raises
    ------
    DataError
        Naming the file, if it is broken or of another size than the calibration's.
    """
    image = decode_grey(path)
    check_resolution(camera, image, path)
    return image


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) of an image file; raises DataError as `decode_grey` does."""
    height, width = decode_grey(path).shape
    return width, height


def list_images(folder: Path) -> list[Path]:
    """Image files of a folder, sorted by name.

    Raises
    ------
    DataError
        If the folder is missing or holds no images.
    """
    if not folder.is_dir():
        raise DataError(f"The image folder {folder} does not exist; give the recording's own folder.")
    found = sorted(p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and p.name[0] != ".")
    if not found:
        kinds = ", ".join(sorted(IMAGE_SUFFIXES))
        raise DataError(f"The folder {folder} holds no images; files ending in {kinds} are read.")
    return found


def named_file(folder: Path, name: str, where: str) -> Path:
    """The file that a list of the recording names.

    Raises
    ------
    DataError
        Naming ``where``, if the name leads out of the folder: it is absolute, or goes up.
    """
    parts = name.replace("\\", "/").split("/")
    if "\0" in name or ".." in parts or not parts[0] or ":" in parts[0]:
        raise DataError(
            f"The file name '{name}' in {where} leads out of the recording; name files below {folder}."
        )
    return folder / name


def require_files(paths: list[Path]) -> None:
    """Check that every listed image exists.

    Raises
    ------
    DataError
        Naming the first missing file and how many are missing.
    """
    missing = [p for p in paths if not os.path.isfile(p)]  # False also for a name that is too long
    if missing:
        raise DataError(
            f"{len(missing)} of {len(paths)} listed images are missing, the first is {missing[0]}; "
            "restore them or take their lines out of the list."
        )

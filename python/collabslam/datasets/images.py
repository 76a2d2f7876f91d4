"""The one place that reads images from disk."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from decimal import Decimal
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.datasets.calibration import check_size
from collabslam.datasets.gate import tell
from collabslam.datasets.image_header import SIGNATURES, Header, read_header
from collabslam.datasets.image_names import of_one_kind
from collabslam.datasets.units import has_nanosecond_parts, padded
from collabslam.errors import DataError
from collabslam.formats.decoder_limit import MOST_PIXELS
from collabslam.formats.files import read_bytes, require_regular
from collabslam.types import Image

SMALL, DENSEST = 1 << 24, 1100
"""Pixels that any header may promise, and so many more for each byte of the file (DEFLATE's best is 1032)."""
MOST_PASSED = 1 << 29
"""Pixels that all passes over an image may go over: 64 scans of 8 megapixels, ten of 50."""
IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".bmp", ".tif", ".tiff"})
DEPTHS = (8, 10, 12, 14, 16)
"""Bits that cameras deliver."""
SAMPLED = 64
"""Deep images of which the largest value is looked at, spread over a recording."""
_BRIGHTER = 50
"""One in so many may be brighter than the range: what one broken pixel costs is one image."""
_LARGEST = 1 << 28
"""Bytes of an image's file."""


def decode_grey(path: Path, camera: Camera | None = None) -> Image:
    """Read an image file as (H, W) uint8 grey; colour is converted, EXIF orientation is ignored.

    Parameters
    ----------
    path : Path
    camera : Camera, optional
        That took it: an image of another size is refused before it is decoded.

    Raises
    ------
    DataError
        Naming the file, if it is missing, empty, cut short, no image, of another size, or no regular file.
    """
    data = _content(path)
    header = read_header(data)
    bits = None if header is None or header.stated else used_bits(path.parent, path.suffix)
    return decode(data, str(path), camera, bits)


def decode(
    data: bytes, where: str, camera: Camera | None = None, bits: int | None = None, mosaic: int | None = None
) -> Image:
    """Decode the content of an image file as (H, W) uint8 grey.

    Parameters
    ----------
    data : bytes
        Of one of `SIGNATURES`, whatever the file is called.
    where : str
        What to call it in an error.
    camera : Camera, optional
        That took it.
    bits : int, optional
        That an image of more than 8 bits uses of each sample, if its header does not state them.
    mosaic : int, optional
        OpenCV's conversion of a Bayer pattern to grey, if an image of one channel is a mosaic.

    Raises
    ------
    DataError
        Naming ``where``, if it is empty, cut short, no image, or of another size.
    """
    header = read_header(data)
    if header is not None and camera is not None and min(header.width, header.height) > 0:
        check_size(camera, (header.width, header.height), where)
    image = None if header is None else _decoded(data, header, mosaic)
    if header is None or image is None:
        raise DataError(
            f"The image {where} is empty, cut short or not an image that is read ({SIGNATURES}); copy it "
            "again from the source, or convert it."
        )
    return shallow(image, header.bits if bits is None or header.stated else bits)


def _decoded(data: bytes, header: Header, mosaic: int | None = None) -> np.ndarray | None:
    """The picture, grey; None if it is none, promises more than its bytes can hold, or costs too much."""
    pixels = header.width * header.height
    if not 0 < pixels <= min(SMALL + DENSEST * len(data), MOST_PIXELS, MOST_PASSED // max(header.passes, 1)):
        return None
    flags = cv2.IMREAD_GRAYSCALE if mosaic is None else cv2.IMREAD_ANYCOLOR
    flags |= cv2.IMREAD_IGNORE_ORIENTATION | cv2.IMREAD_ANYDEPTH
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        return None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        return None
    if image.shape[:2] != (header.height, header.width):
        return None
    if mosaic is not None:
        image = cv2.cvtColor(image, mosaic if image.ndim == 2 else cv2.COLOR_BGR2GRAY)
    return image


def shallow(image: np.ndarray, bits: int) -> Image:
    """An image of 8 or more used bits as uint8: the most significant eight; white where it uses more."""
    if image.dtype == np.uint8:
        return np.asarray(image, dtype=np.uint8)
    return np.asarray(np.minimum(image >> max(bits - 8, 0), 255), dtype=np.uint8)


@lru_cache(maxsize=64)
def used_bits(folder: Path, suffix: str) -> int:
    """Bits that a folder's deep images use, as some spread over it show; one of `DEPTHS`.

    Cameras store 10 or 12 bits in files of 16 that do not say so. All images of a folder are taken alike.
    """
    paths = sorted(p for p in folder.iterdir() if p.suffix == suffix and p.name[0] != ".")
    spread = np.unique(np.linspace(0, len(paths) - 1, SAMPLED).round().astype(int))
    bits = common_depth([largest_value(_content(paths[k])) for k in spread])
    tell("depth of pixels", f"{bits} bits, by the largest values of {len(paths)} files", folder)
    return bits


def largest_value(data: bytes) -> int:
    """The largest value of an image file of more than 8 bits that does not state them; 0 of any other."""
    header = read_header(data)
    image = None if header is None or header.stated else _decoded(data, header)
    return 0 if image is None else int(image.max())


def depth_of(largest: int) -> int:
    """The least of `DEPTHS` that holds a value."""
    return next(bits for bits in DEPTHS if largest >> bits == 0)


def common_depth(largest: Iterable[int]) -> int:
    """The least of `DEPTHS` that holds the largest values of all images but one in `_BRIGHTER`."""
    ranked = sorted(value for value in largest if value)
    return depth_of(ranked[-1 - len(ranked) // _BRIGHTER] if ranked else 0)


def decode_deep(path: Path, camera: Camera) -> np.ndarray:
    """Read an image file of 16 bits, such as a depth image, as (H, W) uint16.

    Parameters
    ----------
    path : Path
    camera : Camera
        Whose size it has.

    Raises
    ------
    DataError
        Naming the file, if it is missing, broken, of another size, or not of 16 bits.
    """
    data = _content(path)
    header = read_header(data)
    if header is not None and min(header.width, header.height) > 0:
        check_size(camera, (header.width, header.height), str(path))
    return deep(data, str(path))


def deep(data: bytes, where: str) -> np.ndarray:
    """The content of an image file of 16 bits as (H, W) uint16; DataError if it is none."""
    header = read_header(data)
    image = None if header is None else _decoded(data, header)
    if image is None or image.dtype != np.uint16:
        raise DataError(f"The depth image {where} is broken, or not of 16 bits; give 16-bit PNG files.")
    return image


def _content(path: Path) -> bytes:
    try:
        return read_bytes(path, _LARGEST)
    except OSError as error:
        raise DataError(
            f"The image {path} cannot be read ({error.strerror}); restore the file or take it out of the "
            "recording."
        ) from error


def read_grey(path: Path, camera: Camera) -> Image:
    """Read an image of a camera; raises DataError as `decode_grey` does."""
    return decode_grey(path, camera)


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) of an image file; raises DataError as `decode_grey` does."""
    height, width = decode_grey(path).shape
    return width, height


def list_images(folder: Path) -> list[Path]:
    """Image files of a folder in the order of their names: 2 before 10.

    Raises
    ------
    DataError
        If the folder is missing or holds no images.
    """
    if not folder.is_dir():
        raise DataError(f"The image folder {folder} does not exist; give the recording's own folder.")
    found = [p for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES and p.name[0] != "."]
    stems = [p.stem for p in found]
    if has_nanosecond_parts(stems):
        found.sort(key=lambda p: Decimal(padded(p.stem)))
    else:
        decimals = all(re.fullmatch(r"-?[0-9]+(\.[0-9]+)?", stem) for stem in stems)
        found.sort(key=_decimals if decimals else natural)
    for path in found:
        require_regular(path)
    if not found:
        kinds = ", ".join(sorted(IMAGE_SUFFIXES))
        raise DataError(f"The folder {folder} holds no images; files ending in {kinds} are read.")
    return of_one_kind(found)


def natural(path: Path) -> tuple[list[str | int], str]:
    """A key that sorts files by the numbers in their names."""
    parts = re.split(r"([0-9]+)", path.name)
    return [int(part) if k % 2 else part for k, part in enumerate(parts)], path.name


def _decimals(path: Path) -> tuple[Decimal, str]:
    return Decimal(path.stem), path.name


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

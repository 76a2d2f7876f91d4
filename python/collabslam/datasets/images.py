"""The one place that reads images from disk."""

from __future__ import annotations

import os
from collections import Counter
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.datasets.calibration import check_size
from collabslam.datasets.deep_range import SAMPLED, Extent, Range, common_range, extent_of
from collabslam.datasets.gate import tell
from collabslam.datasets.image_header import SIGNATURES, Header, read_header
from collabslam.datasets.image_kinds import FILM, FOREIGN, kind_of, ours
from collabslam.datasets.image_names import in_order_of_names, of_one_kind
from collabslam.datasets.mosaic import LOOKED_AT, MOSAIC_TOLD, mosaic_of
from collabslam.errors import DataError
from collabslam.formats.decoder_limit import MOST_PIXELS
from collabslam.formats.files import read_bytes, require_regular
from collabslam.types import Image

SMALL, DENSEST = 1 << 24, 1100
"""Pixels that any header may promise, and so many more for each byte of the file (DEFLATE's best is 1032)."""
MOST_PASSED = 1 << 29
"""Pixels that all passes over an image may go over: 64 scans of 8 megapixels, ten of 50."""
IMAGE_SUFFIXES = frozenset(
    {".png", ".jpg", ".jpeg", ".jpe", ".jfif", ".pgm", ".ppm", ".pnm", ".bmp", ".tif", ".tiff"}
)
_LEAST_SWAPPED, _SMOOTHER = 256.0, 8.0
"""Step between neighbouring depths that no scene has; how much smaller it is with the bytes in order."""
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
    if header is None:
        return decode(data, str(path), camera)
    _check_size(header, camera, str(path))
    deep = None if header.bits <= 8 else used_range(path.parent, path.suffix)
    mosaic = None if header.channels != 1 else mosaic_in(path.parent, path.suffix)
    return decode(data, str(path), camera, deep, mosaic)


def decode(
    data: bytes,
    where: str,
    camera: Camera | None = None,
    deep: Range | None = None,
    mosaic: int | None = None,
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
    deep : Range, optional
        Of the values of an image of more than 8 bits; what its header states unless given.
    mosaic : int, optional
        OpenCV's conversion of a Bayer pattern to grey, if an image of one channel is a mosaic.

    Raises
    ------
    DataError
        Naming ``where``, if it is empty, cut short, no image, or of another size.
    """
    header = read_header(data)
    _check_size(header, camera, where)
    image = None if header is None else _decoded(data, header, mosaic)
    if header is None or image is None:
        raise DataError(_no_image(data, where))
    return (deep or Range(0, header.bits)).grey(image)


def _no_image(data: bytes, where: str) -> str:
    """What is wrong with a file that is no image, and what to do."""
    kind, begun = kind_of(data), ours(data)
    if not data:
        return f"The image {where} is empty; copy it again from the source."
    if kind is not None:
        return f"The image {where} is {kind.name}, which is not read ({SIGNATURES} are); {kind.remedy}."
    if begun is not None:
        return (
            f"The image {where} is {begun} that is cut short or broken, moves, has other samples than whole "
            f"numbers of 8 or 16 bits, or is larger than any that is read ({MOST_PIXELS >> 20} million "
            "pixels); copy it again, or convert it."
        )
    return (
        f"The image {where} is not an image that is read ({SIGNATURES}); copy it again from the source, or "
        "convert it."
    )


def _check_size(header: Header | None, camera: Camera | None, where: str) -> None:
    if header is not None and camera is not None and min(header.width, header.height) > 0:
        check_size(camera, (header.width, header.height), where)


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


@lru_cache(maxsize=64)
def used_range(folder: Path, suffix: str) -> Range:
    """The range of a folder's deep images, as some spread over it show; all of them are taken alike."""
    contents = _spread(folder, suffix, SAMPLED)
    found = common_range(map(extent, contents))
    tell("depth of pixels", f"{found}, by the values of {len(contents)} files", folder)
    return found


@lru_cache(maxsize=64)
def mosaic_in(folder: Path, suffix: str) -> int | None:
    """OpenCV's conversion of the Bayer mosaic that a folder's images of one channel are, if they are."""
    images = [one_channel(content) for content in _spread(folder, suffix, LOOKED_AT)]
    code = mosaic_of([image for image in images if image is not None])
    if code is not None:
        tell("pixels", MOSAIC_TOLD, folder)
    return code


def one_channel(data: bytes) -> np.ndarray | None:
    """The picture of an image file of one channel, (H, W); None of any other."""
    header = read_header(data)
    return None if header is None or header.channels != 1 else _decoded(data, header)


def _spread(folder: Path, suffix: str, count: int) -> list[bytes]:
    """The contents of some of a folder's images, from the first to the last; of those that can be read."""
    paths = sorted(p for p in folder.iterdir() if p.suffix == suffix and p.name[0] != ".")
    chosen = np.unique(np.linspace(0, len(paths) - 1, count).round().astype(int))
    found = []
    for k in chosen:
        with suppress(DataError):
            found.append(_content(paths[k]))
    return found


def extent(data: bytes) -> Extent:
    """The extent of an image file of more than 8 bits; its largest value is 0 of any other.

    Where the header states how many bits are used, the largest value is what they hold.
    """
    header = read_header(data)
    image = None if header is None or header.bits <= 8 else _decoded(data, header)
    if header is None or image is None or image.dtype == np.uint8:
        return Extent(0, 0, 0)
    found = extent_of(image)
    return found._replace(largest=(1 << header.bits) - 1) if header.stated else found


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
    _check_size(header, camera, str(path))
    return deep(data, str(path))


def deep(data: bytes, where: str) -> np.ndarray:
    """The content of an image file of 16 bits as (H, W) uint16; DataError if it is none."""
    header = read_header(data)
    image = None if header is None else _decoded(data, header)
    if image is None or image.dtype != np.uint16:
        kind = kind_of(data)
        found = "broken, or not of 16 bits" if kind is None else f"{kind.name}, which is not read"
        raise DataError(f"The depth image {where} is {found}; give 16-bit PNG files.")
    if (steps := _steps(image)) > _LEAST_SWAPPED and _steps(image.byteswap()) < steps / _SMOOTHER:
        raise DataError(
            f"The two bytes of each depth in {where} are exchanged (another program's order of bytes); write "
            "them again, as array.byteswap()."
        )
    return image


def _steps(depths: np.ndarray) -> float:
    """Median step from a depth to its neighbour in the row, both measured; 0 where there are none."""
    one, other = depths[:, :-1], depths[:, 1:]
    known = (one > 0) & (other > 0)
    return float(np.median(np.abs(one[known].astype(np.int64) - other[known]))) if known.any() else 0.0


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
    for path in found:
        require_regular(path)
    others = unread_images(folder)
    if sum(others.values()) > len(found):
        kinds = ", ".join(f"{count} {kind}" for kind, count in others.items())
        beside = f" beside {len(found)} that are" if found else ""
        raise DataError(
            f"The folder {folder} holds images that are not read ({kinds}){beside}; convert them to PNG or "
            "JPEG, each with its number (ffmpeg -i IN OUT.png, or magick mogrify -format png FILES)."
        )
    if not found:
        kinds = ", ".join(sorted(IMAGE_SUFFIXES))
        raise DataError(f"The folder {folder} holds no images; files ending in {kinds} are read.")
    for kind, count in others.items():
        tell("passed over", f"{count} {kind} images, which are not read", folder)
    return of_one_kind(in_order_of_names(found))


def single_image(path: Path) -> str | None:
    """What to say of an image, or another kind of file that is known, in place of a recording."""
    try:
        with path.open("rb") as file:
            start = file.read(64)
    except OSError:
        return None
    kind, name = kind_of(start), ours(start)
    if kind is None:
        remedy = "give the folder of its images"
        return None if name is None else f"{path} is {name}, not a recording; {remedy}, or a film."
    remedy = "rename it so that it ends in .mp4" if kind.remedy == FILM else kind.remedy
    return f"{path} is {kind.name}, which is not read as a recording; {remedy}."


def unread_images(folder: Path) -> dict[str, int]:
    """How many images of each kind a folder holds that are not read, by the ends of their names."""
    ends = (FOREIGN.get(p.suffix.lower()) for p in folder.iterdir() if p.name[0] != ".")
    return dict(Counter(kind for kind in ends if kind is not None))


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

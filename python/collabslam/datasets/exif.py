"""The focal length that a photograph's EXIF block states."""

from __future__ import annotations

from pathlib import Path

from collabslam.formats.files import read_bytes

_MOST_ENTRIES = 512
_EXIF_BLOCK, _FOCAL_LENGTH_35 = 0x8769, 0xA405
_DIAGONAL = 43.267  # millimetres of the film that equivalent focal lengths are for
_RANGE = (5, 1000)  # millimetres that are believed


def equivalent_focal_length(path: Path) -> float | None:
    """The focal length of a JPEG file as a share of its image's diagonal; None if it does not say."""
    try:
        data = read_bytes(path)
    except OSError:
        return None
    millimetres = _stated(data) if data[:2] == b"\xff\xd8" else None
    if millimetres is None or not _RANGE[0] <= millimetres <= _RANGE[1]:
        return None
    return millimetres / _DIAGONAL


def _stated(data: bytes) -> int | None:
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at + 1] == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            return _in_tiff(data[at + 10 : at + 2 + length])
        if data[at + 1] == 0xDA or length < 2:  # the picture itself
            return None
        at += 2 + length
    return None


def _in_tiff(block: bytes) -> int | None:
    order = {b"II": "little", b"MM": "big"}.get(block[:2])
    if order is None:
        return None
    first = _entry(block, _number(block, 4, 4, order), _EXIF_BLOCK, order)
    if first is None:
        return None
    stated = _entry(block, _number(block, first + 8, 4, order), _FOCAL_LENGTH_35, order)
    return None if stated is None else _number(block, stated + 8, 2, order)


def _entry(block: bytes, directory: int, tag: int, order: str) -> int | None:
    """Where a directory's entry of a tag begins."""
    count = min(_number(block, directory, 2, order), _MOST_ENTRIES)
    starts = (directory + 2 + 12 * k for k in range(count))
    return next((at for at in starts if _number(block, at, 2, order) == tag), None)


def _number(block: bytes, at: int, size: int, order: str) -> int:
    return int.from_bytes(block[at : at + size], "little" if order == "little" else "big")

"""The segments of a JPEG as libjpeg reads them; whatever it might read otherwise is none."""

from __future__ import annotations

import re
from typing import NamedTuple

MOST_SCANS = 64
"""Of a JPEG; cameras and programs write a dozen, and each costs a pass over the whole picture."""
_AFTER_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
"""What ends a scan: a marker that is none of the scan's own."""
_START, _END, _SCAN, _FILL, _EMPTY = 0xD8, 0xD9, 0xDA, 0xFF, 0x01
_FRAMES = frozenset((0xC0, 0xC1, 0xC2, 0xC9, 0xCA))
"""Frames that are decoded: baseline, extended and progressive ones, the last two arithmetic too."""
_TABLES = frozenset((0xC4, 0xCC, 0xDB, 0xDC, 0xDD, 0xFE, *range(0xE0, 0xF0)))
"""Segments that may stand beside them: tables, restarts, comments and applications'."""


class JpegFrame(NamedTuple):
    """Width and height in pixels, channels, and passes over the picture."""

    width: int
    height: int
    channels: int
    scans: int


def read_jpeg(data: bytes) -> JpegFrame | None:
    """The frame of a JPEG; None if a segment up to the picture's end is not whole, or not one of a picture.

    What follows the picture's end is a trailer, as phones write it.
    """
    at, frame, scans = 2, None, 0
    while at + 2 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == _END:
            return JpegFrame(*frame, scans) if frame is not None and scans else None
        if marker in (_FILL, _EMPTY):  # without a length
            at += 1 if marker == _FILL else 2
            continue
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if length < 2 or at + 2 + length > len(data):
            return None
        if marker in _FRAMES:
            if frame is not None or length < 11:
                return None
            height, width = (int.from_bytes(data[at + k : at + k + 2], "big") for k in (5, 7))
            frame = width, height, data[at + 9]
        elif marker == _SCAN:
            scans += 1
            after = _AFTER_SCAN.search(data, at + 2 + length)
            if frame is None or after is None or scans > MOST_SCANS:
                return None
            at = after.start()
            continue
        elif marker not in _TABLES:
            return None  # a decoder passes over it otherwise than by its length, or knows no such picture
        at += 2 + length
    return None

"""What the header of an image file says, read before any decoder sees the file.

Only the formats named in `SIGNATURES` are images for this package, whatever a file is called: OpenCV decodes
many more, and some of those take gigabytes for a file of fifty bytes.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from collabslam.datasets.jpeg_header import read_jpeg

_MOVING = (b"acTL", b"fcTL", b"fdAT")
"""Pieces of a PNG that moves; its later pictures have sizes of their own."""
SIGNATURES = "PNG, JPEG, TIFF, BMP, PGM and PPM"


_MOST_TAGS = 1000
_ANYTHING = 0xFFFF
"""The largest sample that writers of 16 bits give, whatever the picture has: it states nothing."""


class Header(NamedTuple):
    """``kind`` of the file, ``width`` and ``height`` in pixels.

    ``bits`` of a sample: 8 or less, or what a deeper image says it uses (16 if it says nothing).
    ``stated`` is whether it says so.  ``passes`` over the whole picture are what decoding it costs.
    ``channels`` are 1 of a picture that may be grey.
    """

    kind: str
    width: int
    height: int
    bits: int = 8
    stated: bool = True
    passes: int = 1
    channels: int = 0


def read_header(data: bytes) -> Header | None:
    """The header of an image file's content; None if it is none of `SIGNATURES`, or cut short.

    A file that lacks its own end is cut short as well; decoders fill the missing part with grey.
    """
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return _png(data)
    if data.startswith(b"\xff\xd8\xff"):
        return _jpeg(data)
    if data[:2] == b"BM":
        return _bmp(data)
    if data[:1] == b"P" and data[1:2] in b"123456" and data[1:2]:
        return _netpbm(data)
    if data[:4] in (b"II*\0", b"MM\0*"):
        return _tiff(data)
    return None


def _png(data: bytes) -> Header | None:
    if data[12:16] != b"IHDR" or len(data) < 33:
        return None
    width, height = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
    bits, stated, at = data[24], data[24] <= 8, 8
    grey = int(data[25] == 0)  # the kind of its colours; palettes (3) and alpha (4) have more
    while at + 12 <= len(data):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        if kind == b"sBIT" and bits == 16 and 1 <= length <= 4:
            bits, stated = max(data[at + 8 : at + 8 + length]), True
        at += 12 + length
        if kind in _MOVING:
            return None
        if kind == b"IEND":
            return Header("PNG", width, height, bits, stated, channels=grey) if at <= len(data) else None
    return None


def _jpeg(data: bytes) -> Header | None:
    frame = read_jpeg(data)
    return (
        None
        if frame is None
        else Header("JPEG", frame.width, frame.height, passes=frame.scans, channels=frame.channels)
    )


def _bmp(data: bytes) -> Header | None:
    if len(data) < 26 or int.from_bytes(data[14:18], "little") < 40:
        return None
    width, height = (int.from_bytes(data[at : at + 4], "little", signed=True) for at in (18, 22))
    grey = int(int.from_bytes(data[28:30], "little") == 8)
    return Header("BMP", abs(width), abs(height), channels=grey)


def _netpbm(data: bytes) -> Header | None:
    words = re.sub(rb"#[^\r\n]*", b" ", data[2:512]).split()
    needed = 2 if data[1:2] in b"14" else 3
    if len(words) < needed or not all(w.isdigit() and len(w) < 10 for w in words[:needed]):
        return None
    width, height = int(words[0]), int(words[1])
    most = int(words[2]) if needed == 3 else 1
    grey = int(data[1:2] in b"25")
    return Header("PGM or PPM", width, height, max(most.bit_length(), 1), most != _ANYTHING, channels=grey)


def _tiff(data: bytes) -> Header | None:
    """From the tags of the first picture: width 256, height 257, bits 258, largest sample 281."""
    order = "little" if data[:2] == b"II" else "big"

    def number(at: int, size: int) -> int:
        return int.from_bytes(data[at : at + size], order)  # type: ignore[arg-type]

    first = number(4, 4)
    if first + 2 > len(data):
        return None
    tags: dict[int, int] = {}
    seen: set[int] = set()
    if number(first, 2) > _MOST_TAGS:
        return None
    for k in range(number(first, 2)):
        at = first + 2 + 12 * k
        kind, count = number(at + 2, 2), number(at + 4, 4)
        size = {1: 1, 3: 2, 4: 4}.get(kind)
        if number(at, 2) in seen or (number(at, 2) in (256, 257) and count != 1):
            return None  # decoders differ about which of them holds
        seen.add(number(at, 2))
        if size is not None and at + 12 <= len(data):
            place = at + 8 if size * count <= 4 else number(at + 8, 4)
            tags[number(at, 2)] = number(place, size)
    if 256 not in tags or 257 not in tags:
        return None
    bits, grey = tags.get(258, 1), int(tags.get(277, 1) == 1 and tags.get(262) in (0, 1))
    stated = bits <= 8
    if bits > 8 and tags.get(281, _ANYTHING) != _ANYTHING:
        bits, stated = max(tags[281].bit_length(), 1), True
    return Header("TIFF", tags[256], tags[257], bits, stated, channels=grey)

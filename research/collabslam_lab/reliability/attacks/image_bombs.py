"""Pictures whose header says one thing to us and another to a decoder, which takes gigabytes or minutes."""

from __future__ import annotations

import struct
from collections.abc import Callable

import cv2
import numpy as np

from collabslam_lab.reliability.attacks.attack import REFUSED, Attack, Deed
from collabslam_lab.reliability.attacks.scene import Scene

FRAME = 4
"""The frame of Cs that is spoilt."""
_GREY = np.random.default_rng(8).integers(0, 255, (24, 32)).astype(np.uint8)


def _encoded(suffix: str) -> bytes:
    return bytes(cv2.imencode(suffix, _GREY)[1])


def segment(marker: int, body: bytes) -> bytes:
    return bytes((0xFF, marker)) + struct.pack(">H", len(body) + 2) + body


def frame(width: int, height: int, marker: int = 0xC0) -> bytes:
    return segment(marker, struct.pack(">BHHB", 8, height, width, 1) + b"\1\x11\0")


SCAN = segment(0xDA, b"\1\1\0\0\x3f\0")
HUGE = frame(65500, 65500)
JPEG = _encoded(".jpg")
AT = JPEG.index(b"\xff\xc0")
END = len(JPEG) - 2
HIDDEN: dict[str, bytes] = {
    "a marker without a length hides a frame": JPEG[:2]
    + b"\xff\x00"
    + struct.pack(">H", len(HUGE) + 2)
    + HUGE
    + JPEG[2:],
    "restarts outside a scan": JPEG[:2] + b"\xff\xd0" + struct.pack(">H", len(HUGE) + 2) + HUGE + JPEG[2:],
    "a second beginning": JPEG[:2] + b"\xff\xd8" + struct.pack(">H", len(HUGE) + 2) + HUGE + JPEG[2:],
    "a reserved marker": JPEG[:2] + segment(0x02, HUGE) + JPEG[2:],
    "a JPEG of extensions": JPEG[:2] + segment(0xC8, HUGE) + JPEG[2:],
    "two frames": JPEG[:AT] + frame(32, 24) + HUGE + JPEG[AT:],
    "a frame after the scan": JPEG[:END] + HUGE + JPEG[END:],
    "a scan before the frame": JPEG[:AT] + SCAN + JPEG[AT:],
    "a hierarchical frame": JPEG[:AT] + b"\xff\xc5" + JPEG[AT + 2 :],
    "a lossless frame": JPEG[:AT] + b"\xff\xc3" + JPEG[AT + 2 :],
    "a length of one": JPEG[:2] + b"\xff\xfe\0\1" + JPEG[2:],
    "a length beyond the end": JPEG[:2] + b"\xff\xfe\xff\xff" + JPEG[2:],
    "bytes between segments": JPEG[:2] + b"\0\0\0" + JPEG[2:],
    "scans without end": JPEG[:END] + SCAN * 22_574 + JPEG[END:],
    "no end": JPEG[:END],
}


def tiff_of(*tags: tuple[int, int, int, int]) -> bytes:
    rows = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + rows + bytes(4 + 32 * 24)


WIDTH, HEIGHT = (256, 4, 1, 32), (257, 4, 1, 24)
OTHERWISE = {
    "pgm": b"P5\n#\r60000 60000\n32 24\n255\n" + bytes(32 * 24),
    "apng": _encoded(".png")[:33] + struct.pack(">I", 8) + b"acTL" + bytes(12)
    + _encoded(".png")[33:],
    "tiff-twice": tiff_of(WIDTH, (256, 4, 1, 60000), HEIGHT),
    "tiff-twice-signed": tiff_of((256, 9, 1, 60000), WIDTH, HEIGHT),
    "tiff-twice-long": tiff_of((256, 16, 1, 60000), WIDTH, HEIGHT),
    "tiff-two-widths": tiff_of((256, 3, 2, 32), HEIGHT),
    "tiff-tags": tiff_of(WIDTH, HEIGHT, *((300 + k, 3, 1, 0) for k in range(1000)), (256, 4, 1, 60000)),
}  # fmt: skip


def _spoilt(data: bytes) -> Callable[[Scene], Deed]:
    def make(scene: Scene) -> Deed:
        walk = scene.copy("short")
        path = sorted((walk / "cam0" / "data").iterdir(), key=lambda p: int(p.stem))[FRAME]
        path.write_bytes(data)
        return scene.run(source=walk)

    return make


ATTACKS = tuple(
    Attack(
        "image",
        f"bomb-{name.replace(' ', '-')}",
        f"a picture of two sizes: {name}",
        _spoilt(data),
        REFUSED,
        "png",
    )
    for name, data in (HIDDEN | OTHERWISE).items()
)

"""Image files that are not what they are called, promise more than they hold, or wait for ever."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from collabslam_lab.reliability.attacks.attack import (
    HELD,
    READ_OR_REFUSED,
    REFUSED,
    Attack,
    AttackOutcome,
    Deed,
)
from collabslam_lab.reliability.attacks.scene import Scene

FRAME = 4
"""The frame of Cs that is spoilt; those before it are good."""
Spoil = Callable[[Path, bytes], None]


def _image(data: bytes) -> np.ndarray:
    return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED))


def _encoded(suffix: str, image: np.ndarray) -> bytes:
    return bytes(cv2.imencode(suffix, image)[1])


def _holding(make: Callable[[bytes], bytes] | bytes) -> Spoil:
    return lambda path, data: _write(path, make if isinstance(make, bytes) else make(data))


def _write(path: Path, data: bytes) -> None:
    path.write_bytes(data)


def _linked(target: str) -> Spoil:
    def spoil(path: Path, _: bytes) -> None:
        path.unlink()
        path.symlink_to(target)

    return spoil


def _replaced(make: Callable[[Path], object]) -> Spoil:
    def spoil(path: Path, _: bytes) -> None:
        path.unlink()
        make(path)

    return spoil


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _png(width: int, height: int, rows: bytes, more: bytes = b"") -> bytes:
    head = _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + more + _chunk(b"IDAT", rows) + _chunk(b"IEND", b"")


def _zeros(count: int) -> bytes:
    """So many zero bytes, compressed without ever being there."""
    machine, parts, piece = zlib.compressobj(9), list[bytes](), bytes(1 << 20)
    parts += [machine.compress(piece) for _ in range(count >> 20)]
    return b"".join([*parts, machine.flush()])


def _sparse(path: Path, data: bytes) -> None:
    os.truncate(path, 5_000_000_000)


def _bmp(data: bytes) -> bytes:
    bmp = bytearray(_encoded(".bmp", _image(data)))
    bmp[18:26] = struct.pack("<ii", 60000, 60000)
    return bytes(bmp)


def _jpeg(data: bytes) -> bytes:
    jpeg = bytearray(_encoded(".jpg", _image(data)))
    at = jpeg.index(b"\xff\xc0")
    jpeg[at + 5 : at + 9] = struct.pack(">HH", 65500, 65500)
    return bytes(jpeg)


def _tiff(data: bytes) -> bytes:
    tiff = bytearray(_encoded(".tif", _image(data)))
    directory = struct.unpack_from("<I", tiff, 4)[0]
    count = struct.unpack_from("<H", tiff, directory)[0]
    struct.pack_into("<I", tiff, directory + 2 + 12 * count, directory)  # the next directory is this one
    return bytes(tiff)


def _flipped(data: bytes) -> bytes:
    spoilt = bytearray(data)
    spoilt[len(data) // 2] ^= 255
    return bytes(spoilt)


def _rgba(data: bytes) -> bytes:
    return _encoded(".png", cv2.cvtColor(_image(data), cv2.COLOR_GRAY2BGRA))


_GIF = b"GIF89a" + struct.pack("<HH", 40000, 40000) + b"\x80\0\0\0\0\0\xff\xff\xff," + b"\0" * 4
_PAM = b"P7\nWIDTH 9000\nHEIGHT 9000\nDEPTH 1\nMAXVAL 255\nENDHDR\n"
_TEXTS = b"".join(_chunk(b"tEXt", b"a\0b") for _ in range(100_000))

SPOILT: tuple[tuple[str, str, Spoil, tuple[AttackOutcome, ...]], ...] = (
    ("empty", "an empty file", _holding(b""), REFUSED),
    ("cut", "cut off in its middle", _holding(lambda d: d[: len(d) // 2]), READ_OR_REFUSED),
    ("flipped", "a byte in its middle turned over", _holding(_flipped), READ_OR_REFUSED),
    ("text", "a text of that name", _holding(b"not an image\n" * 100), REFUSED),
    ("page", "a web page of that name", _holding(b"<!DOCTYPE html><html><svg onload=x></html>"), REFUSED),
    ("gif", "46 bytes of GIF that make 40000x40000 pixels", _holding(_GIF), REFUSED),
    ("webp", "a WebP file of that name", _holding(b"RIFF\x10\0\0\0WEBPVP8 "), REFUSED),
    ("exr", "an OpenEXR file of that name", _holding(b"\x76\x2f\x31\x01" + b"\0" * 60), REFUSED),
    ("hdr", "a Radiance file of 9999x9999", _holding(b"#?RADIANCE\n\n-Y 9999 +X 9999\n"), REFUSED),
    ("jpeg2000", "a JPEG 2000 file of that name", _holding(b"\0\0\0\x0cjP  \r\n\x87\n"), REFUSED),
    ("pam", "a PAM file of 9000x9000", _holding(_PAM),
     REFUSED),
    ("pfm", "a float map of that name", _holding(b"Pf\n9 9\n-1\n"), REFUSED),
    ("bmp", "a BMP whose header promises 60000x60000", _holding(_bmp), REFUSED),
    ("jpeg", "a JPEG whose header promises 65500x65500", _holding(_jpeg), REFUSED),
    ("tiff", "a TIFF whose directory follows itself", _holding(_tiff), READ_OR_REFUSED),
    ("pgm", "a PGM of 10^9 columns", _holding(b"P5\n1000000000 1000000000\n255\n"), REFUSED),
    ("pgm-zero", "a PGM whose white is 0", _holding(b"P5\n720 480\n0\n" + bytes(345600)), REFUSED),
    ("deflated", "a PNG of 30000x30000 in 0.9 MB",
     _holding(lambda _: _png(30000, 30000, _zeros(900_000_000))),
     REFUSED),
    ("overlong", "a PNG of the right size with a gigabyte too much in it",
     _holding(lambda _: _png(720, 480, _zeros(1 << 30))), READ_OR_REFUSED),
    ("chunks", "a PNG with 100 000 pieces of text",
     _holding(lambda _: _png(720, 480, _zeros(1 << 19), _TEXTS)),
     READ_OR_REFUSED),
    ("half", "a PNG of half the size", _holding(lambda d: _encoded(".png", _image(d)[::2, ::2])), REFUSED),
    ("turned", "a PNG of 480x720", _holding(lambda d: _encoded(".png", _image(d).T)), REFUSED),
    ("one-pixel", "a PNG of one pixel", _holding(lambda d: _encoded(".png", _image(d)[:1, :1])), REFUSED),
    ("deep", "a PNG of 16 bits among those of 8",
     _holding(lambda d: _encoded(".png", _image(d).astype(np.uint16) << 8)), READ_OR_REFUSED),
    ("colour", "a PNG with colours and transparency", _holding(_rgba), HELD),
    ("trailing", "a good PNG with 10 MB behind it", _holding(lambda d: d + bytes(10_000_000)),
     READ_OR_REFUSED),
    ("sparse", "a file of 5 GB", _sparse, REFUSED),
    ("folder", "a folder of that name", _replaced(Path.mkdir), REFUSED),
    ("pipe", "a pipe that nobody writes to", _replaced(os.mkfifo), REFUSED),
    ("device", "a link to /dev/zero", _linked("/dev/zero"), REFUSED),
    ("tty", "a link to /dev/stdin", _linked("/dev/stdin"), REFUSED),
    ("loop", "a link to itself", _replaced(lambda path: path.symlink_to(path.name)), REFUSED),
    ("dangling", "a link to nothing", _linked("nothing.png"), REFUSED),
    ("passwords", "a link to /etc/passwd", _linked("/etc/passwd"), REFUSED),
    ("gone", "no such file, though it is listed", _replaced(lambda path: None), REFUSED),
)  # fmt: skip


def _attack(name: str, what: str, spoil: Spoil, good: tuple[AttackOutcome, ...]) -> Attack:
    def make(scene: Scene) -> Deed:
        walk = scene.copy("short")
        path = sorted((walk / "cam0" / "data").iterdir(), key=lambda p: int(p.stem))[FRAME]
        spoil(path, path.read_bytes())
        return scene.run(source=walk)

    return Attack("image", name, f"image {FRAME} of Cs: {what}", make, good, "png" if good == REFUSED else "")


def _of_cf(name: str, what: str, make_data: Callable[[bytes], bytes] | None) -> Attack:
    def make(scene: Scene) -> Deed:
        walk = scene.copy("short")
        path = sorted((walk / "cam1" / "data").iterdir(), key=lambda p: int(p.stem))[2]
        if make_data is None:
            path.unlink()
        else:
            path.write_bytes(make_data(path.read_bytes()))
        return scene.run(source=walk)

    return Attack("image", name, f"image 2 of Cf: {what}", make, REFUSED, "png")


ATTACKS = (
    *(_attack(*row) for row in SPOILT),
    _of_cf("cf-gone", "no such file, though it is listed", None),
    _of_cf("cf-text", "a text of that name", lambda _: b"not an image"),
    _of_cf("cf-half", "a PNG of half the size", lambda d: _encoded(".png", _image(d)[::2, ::2])),
)

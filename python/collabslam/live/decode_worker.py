"""A process that decodes one device's pictures under limits: whatever a decoder does with one ends only this.

``python -m collabslam.live.decode_worker CAMERA``; CAMERA is a calibration as JSON.  Pictures come on
standard input, each after its length (4 bytes, the highest first); answers go likewise, of length 0 where
there is none.
"""

from __future__ import annotations

import json
import struct
import sys
from typing import Any, BinaryIO

import cv2

from collabslam._core import Camera
from collabslam.errors import CollabslamError
from collabslam.live.decoding import view_image

try:
    import resource
except ImportError:  # a system without such limits
    resource = None  # type: ignore[assignment]

LENGTH = struct.Struct(">I")
CPU_SECONDS = 2
"""Of the processor that a picture may take at most; a whole second of them is sure."""
ROOM = 1 << 27
"""Bytes of memory that a picture may take, and `PER_PIXEL` for each of the calibration's."""
PER_PIXEL = 64


def main(words: list[str]) -> int:
    """Decode until standard input ends."""
    cv2.setNumThreads(0)  # their stacks would count
    camera = Camera(*json.loads(words[0]))
    _limit_memory(ROOM + PER_PIXEL * camera.width * camera.height)
    taken, given = sys.stdin.buffer, sys.stdout.buffer
    while (data := _read(taken)) is not None:
        _limit_time()
        try:
            answer = view_image(data, camera).tobytes()
        except (CollabslamError, MemoryError):
            answer = b""
        given.write(LENGTH.pack(len(answer)) + answer)
        given.flush()
    return 0


def _read(stream: BinaryIO) -> bytes | None:
    head = stream.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack(head)
    data = stream.read(length)
    return data if len(data) == length else None


def _limit_memory(room: int) -> None:
    """From what is in use now; neither files nor processes are made from here on."""
    if resource is None:
        return
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            used = int(file.read().split()[0]) * resource.getpagesize()
        _set(resource.RLIMIT_AS, used + room)
    except OSError:
        pass  # a system that does not tell: its other limits hold
    _set(resource.RLIMIT_FSIZE, 0)
    _set(resource.RLIMIT_CORE, 0)


def _limit_time() -> None:
    """For the next picture."""
    if resource is not None:
        used = resource.getrusage(resource.RUSAGE_SELF)
        _set(resource.RLIMIT_CPU, int(used.ru_utime + used.ru_stime) + CPU_SECONDS, soft=True)


def _set(what: Any, value: int, *, soft: bool = False) -> None:
    hard = resource.getrlimit(what)[1]
    within = value if hard == resource.RLIM_INFINITY else min(value, hard)
    resource.setrlimit(what, (within, hard if soft else within))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

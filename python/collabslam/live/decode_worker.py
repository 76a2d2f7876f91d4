"""A process that decodes one device's pictures under limits: what a decoder does ends only this.

``python -m collabslam.live.decode_worker CAMERA``; CAMERA is a calibration as JSON.  It is asked pictures,
and answers their pixels; without a byte where there are none.
"""

from __future__ import annotations

import json
import sys

import cv2

from collabslam._core import Camera
from collabslam.errors import CollabslamError
from collabslam.formats.worker_limits import limit_memory, limit_time, serve
from collabslam.live.decoding import view_image

CPU_SECONDS = 2
"""Of the processor that a picture may take at most; a whole second of them is sure."""
ROOM = 1 << 27
"""Bytes of memory that a picture may take, and `PER_PIXEL` for each of the calibration's."""
PER_PIXEL = 64


def main(words: list[str]) -> int:
    """Decode until standard input ends."""
    cv2.setNumThreads(0)  # their stacks would count
    camera = Camera(*json.loads(words[0]))
    limit_memory(ROOM + PER_PIXEL * camera.width * camera.height)

    def answer(data: bytes) -> bytes:
        limit_time(CPU_SECONDS)
        try:
            return view_image(data, camera).tobytes()
        except (CollabslamError, MemoryError):
            return b""

    serve(answer)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

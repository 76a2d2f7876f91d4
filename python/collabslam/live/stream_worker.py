"""A process that decodes one video stream of a network under limits: a hostile one ends only this.

``python -m collabslam.live.stream_worker URL``; FFmpeg itself keeps `FORMATS` and `PROTOCOLS`, by
`environment`.  Asked `OPENED`, it answers `READY`, or no byte where there is no such stream; asked `NEXT`, it
waits for an image, and answers `SHAPE` and its grey pixels, or no byte where none comes.
"""

from __future__ import annotations

import os
import struct
import sys
import time

import cv2

from collabslam.formats.video_worker import FORMATS as FILMS
from collabslam.formats.video_worker import ROOM, THREADS, retrieved
from collabslam.formats.worker_limits import limit_memory, limit_time, serve

FORMATS = f"{FILMS},rtsp,rtp,mpjpeg"
"""FFmpeg's demuxers that may be used: none of playlists and the like, which name other places."""
PROTOCOLS = (
    "rtp,srtp,udp,tcp,tls,http,https,httpproxy,rtmp,rtmps,rtmpt,rtmpts,rtmpe,rtmpte,ffrtmphttp,ffrtmpcrypt,"
    "srt,rist"
)
"""Networks alone: no stream is a file."""
OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
"""The variable by which users, too, set options of FFmpeg; theirs stand, but for those of `environment`."""
USUAL = "rtsp_flags;prefer_tcp"
"""As OpenCV has it where nobody sets the variable."""
OPENING_SECONDS, CPU_SECONDS = 20, 5
"""Of the processor that opening a stream may take, and an image; a whole second of them is sure."""
OPENED, NEXT, READY = b"opened", b"next", b"ready"
SHAPE = struct.Struct(">dII")
"""When an image was there, by the system's monotonic clock, seconds; its height and width."""


def environment() -> dict[str, str]:
    """What FFmpeg is to keep, as OpenCV hands it on."""
    kept = {"format_whitelist": FORMATS, "protocol_whitelist": PROTOCOLS}
    return {OPTIONS: "|".join([os.environ.get(OPTIONS) or USUAL, *map(";".join, kept.items())])}


class _Stream:
    def __init__(self, url: str) -> None:
        limit_time(OPENING_SECONDS)
        threads = [cv2.CAP_PROP_N_THREADS, min(THREADS, cv2.getNumberOfCPUs())]
        self._capture = cv2.VideoCapture(url, cv2.CAP_FFMPEG, threads)

    def answer(self, asked: bytes) -> bytes:
        if not self._capture.isOpened():
            return b""
        return READY if asked == OPENED else self._image()

    def _image(self) -> bytes:
        limit_time(CPU_SECONDS)
        if not self._capture.grab():
            return b""
        t = time.monotonic()
        grey = retrieved(self._capture)
        if grey is None:
            return b""
        return SHAPE.pack(t, *grey.shape) + grey.tobytes()


def main(words: list[str]) -> int:
    """Decode until standard input ends."""
    cv2.setNumThreads(0)  # their stacks would count
    limit_memory(ROOM)
    serve(_Stream(words[0]).answer)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

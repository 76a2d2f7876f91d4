"""A process that decodes one video under limits: whatever FFmpeg does with a hostile one ends only this.

``python -m collabslam.formats.video_worker FILE``; FFmpeg itself keeps `FORMATS`, by `environment`.
Asked `SIZE`, it answers `FACTS`; asked `STAMPS`, the stamp of each frame by the container, as
float64; asked for a frame's `NUMBER`, `SHAPE` and its grey pixels.  An answer without a byte says that there
is none.  All numbers have the highest byte first.
"""

from __future__ import annotations

import struct
import sys

import cv2
import numpy as np
from numpy.typing import NDArray

from collabslam.formats.worker_limits import limit_memory, limit_time, serve

FORMATS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,m4v,h264,hevc,mjpeg,flv,ogg,asf,ivf,obu,"
    "av1,mxf,nut,dv,yuv4mpegpipe"
)
"""FFmpeg's demuxers that may be used: none of playlists, which name other files and addresses."""
MOST_PIXELS = 1 << 26
"""Of a frame, 8192 x 8192, by the container; one that turns out larger has the memory that there is."""
THREADS = 4
"""Of a decoder, at most: each holds a frame."""
CPU_SECONDS = 20
"""Of the processor that opening, or a step to the next frame, may take."""
ROOM = 1 << 31
"""Bytes of memory that decoding may take: 8k with 16 reference frames takes half."""
SEEK_SECONDS = 300
"""Of the processor that a jump may take, which decodes all from the picture before that stands alone."""
FAR = 1000
"""Frames that are decoded rather than sought: a jump costs as much as some hundred, where few are whole."""
BEFORE = 32
"""Frames before the wanted one from which on it is decoded: the first ones after a jump may lack others."""
SIZE, STAMPS = b"size", b"stamps"
NUMBER, SHAPE, FACTS = struct.Struct(">Q"), struct.Struct(">II"), struct.Struct(">IId")
"""A frame's number; its height and width; a video's width, height and frames per second (0 if not told)."""


def environment() -> dict[str, str]:
    """What FFmpeg is to keep, as OpenCV hands it on."""
    options = {"format_whitelist": FORMATS, "protocol_whitelist": "file"}
    return {"OPENCV_FFMPEG_CAPTURE_OPTIONS": "|".join(";".join(pair) for pair in options.items())}


def retrieved(capture: cv2.VideoCapture) -> NDArray[np.uint8] | None:
    """The (H, W) uint8 grey image that was grabbed; None if it cannot be decoded."""
    done, image = capture.retrieve()
    if not done or image is None:
        return None
    return np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


class _Film:
    """A frame that is sought is known by its stamp; where it is not, all is decoded from the beginning."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._frames: dict[float, int] = {}
        self._open()

    def _open(self) -> None:
        limit_time(CPU_SECONDS)
        threads = [cv2.CAP_PROP_N_THREADS, min(THREADS, cv2.getNumberOfCPUs())]
        self._capture, self._next = cv2.VideoCapture(self._path, cv2.CAP_FFMPEG, threads), 0

    def _grab(self) -> bool:
        limit_time(CPU_SECONDS)
        there = bool(self._capture.grab())
        self._next += there
        return there

    def answer(self, asked: bytes) -> bytes:
        if not self._capture.isOpened():
            return b""
        facts = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FPS)
        width, height, rate = (self._capture.get(p) for p in facts)
        if not 0.0 < width * height <= MOST_PIXELS:
            return b""
        if asked == SIZE:
            return FACTS.pack(int(width), int(height), rate)
        if asked == STAMPS:
            stamps = []
            while self._grab():
                stamps.append(self._stamp())
            unique = len(set(stamps)) == len(stamps)
            self._frames = {t: k for k, t in enumerate(stamps)} if unique else {}
            return np.asarray(stamps, ">f8").tobytes()
        return self._frame(*NUMBER.unpack(asked))

    def _stamp(self) -> float:
        return float(self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3)

    def _seek(self, i: int) -> None:
        """Let the next frame be one that is not after frame ``i``."""
        target = i - BEFORE
        if target > 0 and self._frames:
            limit_time(SEEK_SECONDS)
            self._capture.set(cv2.CAP_PROP_POS_FRAMES, target)
            if self._grab():
                met = self._frames.get(self._stamp())
                if met is not None and met < i:
                    self._next = met + 1
                    return
        self._open()

    def _frame(self, i: int) -> bytes:
        if (i - self._next if i >= self._next else i) > FAR:
            self._seek(i)
        elif i < self._next:
            self._open()
        while self._next <= i:
            if not self._grab():
                return b""
        grey = retrieved(self._capture)
        if grey is None:
            return b""
        return SHAPE.pack(*grey.shape) + grey.tobytes()


def main(words: list[str]) -> int:
    """Decode until standard input ends."""
    cv2.setNumThreads(0)  # their stacks would count
    limit_memory(ROOM)
    serve(_Film(words[0]).answer)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

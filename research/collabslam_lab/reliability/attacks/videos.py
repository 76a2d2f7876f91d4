"""Films that are lists of others, promise more than they hold, or are damaged where FFmpeg looks."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from collabslam_lab.reliability.attacks.attack import READ_OR_REFUSED, REFUSED, Attack, AttackOutcome, Deed
from collabslam_lab.reliability.attacks.scene import Scene

WIDTH, HEIGHT, FRAMES = 160, 120, 12
SAFE = (*READ_OR_REFUSED, AttackOutcome.TOLD)
CAMERA = (
    '{"camera_model": "pinhole", "resolution": [160, 120], "intrinsics": [150, 150, 79.5, 59.5], '
    '"distortion_model": "none", "distortion_coefficients": []}'
)
Change = Callable[[bytes], bytes]


def _film(path: Path) -> bytes:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (WIDTH, HEIGHT))
    noise = np.random.default_rng(0).integers(0, 255, (HEIGHT // 8, WIDTH // 8, 3), np.uint8)
    image = cv2.resize(noise, (WIDTH, HEIGHT))
    for k in range(FRAMES):
        writer.write(np.roll(image, k, axis=1))
    writer.release()
    return path.read_bytes()


def _run(name: str, change: Change) -> Callable[[Scene], Deed]:
    def make(scene: Scene) -> Deed:
        good = _film(scene.folder / "good.avi")
        path, camera = scene.folder / name, scene.folder / "camera.yaml"
        path.write_bytes(change(good))
        camera.write_text(CAMERA)
        return scene.run("--camera", camera, "--mode", "mono", "--start", "scale-free", source=path)

    return make


def _sized(width: int, height: int) -> Change:
    def change(data: bytes) -> bytes:
        data = data.replace(struct.pack("<II", WIDTH, HEIGHT), struct.pack("<II", width, height))
        return data.replace(struct.pack(">HH", HEIGHT, WIDTH), struct.pack(">HH", height, width))

    return change


def _noisy(data: bytes) -> bytes:
    spoilt = np.frombuffer(data, np.uint8).copy()
    generator = np.random.default_rng(1)
    spoilt[generator.integers(0, len(spoilt), len(spoilt) // 100)] = 255
    return bytes(spoilt)


def _list(text: str) -> Change:
    return lambda _: text.encode()


def _attack(
    name: str, what: str, file: str, change: Change, good: tuple[AttackOutcome, ...] = REFUSED
) -> Attack:
    return Attack("video", name, what, _run(file, change), good, file if good is REFUSED else "")


ATTACKS = (
    _attack("concat", "a list of films for FFmpeg", "a.mp4", _list("ffconcat version 1.0\nfile good.avi\n")),
    _attack("playlist", "a playlist of HTTP streaming", "a.mp4",
            _list("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n/etc/passwd\n#EXT-X-ENDLIST\n")),
    _attack("session", "a description of a stream to listen to", "a.mov",
            _list("v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\n")),
    _attack("empty", "an empty film", "a.mkv", lambda _: b""),
    _attack("large", "frames of 60000x60000", "a.avi", _sized(60000, 60000)),
    _attack("just-beyond", "frames of 8193x8193", "a.avi", _sized(8193, 8193)),
    _attack("turned", "frames of another shape than the calibration's", "a.avi", _sized(120, 160), SAFE),
    _attack("cut", "a film without its second half", "a.avi", lambda data: data[: len(data) // 2], SAFE),
    _attack("noise", "a film with a byte in a hundred overwritten", "a.avi", _noisy, SAFE),
    _attack("lengths", "a film whose chunks are 4 GB long", "a.avi",
            lambda data: data.replace(b"00dc", b"00dc\xff\xff\xff\xff"), SAFE),
)  # fmt: skip

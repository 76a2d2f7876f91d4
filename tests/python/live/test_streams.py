"""A stream of a network as a live camera: its images come, and a hostile one ends its own process alone."""

from __future__ import annotations

import struct
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest

from collabslam import DataError
from collabslam.live import stream_worker
from collabslam.live.cameras import DeviceCamera
from collabslam.live.captures import OpenedStream

WIDTH, HEIGHT = 64, 48
FRAMES = 6


def jpeg(level: int, size: tuple[int, int] = (HEIGHT, WIDTH)) -> bytes:
    return bytes(cv2.imencode(".jpg", np.full(size, level, np.uint8))[1])


def bomb() -> bytes:
    """Pixels that are promised, 65500 x 65500 of them."""
    return jpeg(0).replace(struct.pack(">HH", HEIGHT, WIDTH), struct.pack(">HH", 65500, 65500))


def levels(count: int) -> list[bytes]:
    return [jpeg(40 * k) for k in range(count)]


BODIES = {
    "/good": lambda: levels(FRAMES),
    "/bomb": lambda: [*levels(3), bomb()],
    "/other": lambda: [jpeg(9, (2 * HEIGHT, WIDTH))] * FRAMES,
    "/rubbish": lambda: [bytes(5000)] * FRAMES,
}
LIST = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{}\n#EXT-X-ENDLIST\n"


class Stream(BaseHTTPRequestHandler):
    """A camera that sends JPEGs one after the other, or a list that names other places."""

    def do_GET(self) -> None:
        self.server.asked.append(self.path)  # type: ignore[attr-defined]
        self.send_response(200)
        if self.path.startswith("/list"):
            self.send_header("Content-Type", "application/vnd.apple.mpegurl")
            self.end_headers()
            self.wfile.write(LIST.format("good").encode())
            return
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
        self.end_headers()
        for image in BODIES[self.path]():
            head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(image)}\r\n\r\n"
            self.wfile.write(head.encode() + image + b"\r\n")

    def log_message(self, *_: object) -> None:
        """Nothing."""


@pytest.fixture
def server() -> Iterator[ThreadingHTTPServer]:
    with ThreadingHTTPServer(("127.0.0.1", 0), Stream) as found:
        found.asked = []  # type: ignore[attr-defined]
        threading.Thread(target=found.serve_forever, daemon=True).start()
        yield found
        found.shutdown()


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    path = tmp_path / "camera.yaml"
    path.write_text(
        f"camera_model: pinhole\nresolution: [{WIDTH}, {HEIGHT}]\nintrinsics: [50, 50, 32, 24]\n"
        "distortion_model: none\ndistortion_coeffs: []\n"
    )
    return path


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("collabslam.live.cameras.BROKEN", 2)


def url(server: ThreadingHTTPServer, path: str) -> str:
    return f"http://127.0.0.1:{server.server_address[1]}{path}"


def test_images_come_in_their_order(server: ThreadingHTTPServer, calibration: Path) -> None:
    camera = DeviceCamera(url(server, "/good"), calibration)
    found = []
    with pytest.raises(DataError, match="delivers no more images"):
        found.extend(camera.images(lambda: False))
    assert [int(f.image.mean()) for f in found] == [40 * k for k in range(FRAMES)]
    stamps = [f.t for f in found]
    assert stamps == sorted(stamps)
    assert stamps[-1] <= camera.clock.now()


def test_images_of_another_size_are_refused(server: ThreadingHTTPServer, calibration: Path) -> None:
    with pytest.raises(DataError, match="is 64x96 but its camera"):
        next(DeviceCamera(url(server, "/other"), calibration).images(lambda: False))


@pytest.mark.parametrize("path", ["/bomb", "/list", "/list.m3u8"])
def test_what_is_no_stream_is_not_opened(server: ThreadingHTTPServer, calibration: Path, path: str) -> None:
    """Pixels that are not there, and lists: no address is asked but the one that was named."""
    with pytest.raises(DataError, match="cannot be opened"):
        DeviceCamera(url(server, path), calibration)
    assert set(server.asked) == {path}  # type: ignore[attr-defined]


@pytest.mark.parametrize("scheme", ["file", "concat", "subfile,,start,0,end,9,,:file", "data"])
def test_no_stream_is_a_file(calibration: Path, scheme: str) -> None:
    with pytest.raises(DataError, match="cannot be opened"):
        DeviceCamera(f"{scheme}://{calibration}", calibration)


def test_rubbish_is_no_image(server: ThreadingHTTPServer, calibration: Path) -> None:
    with pytest.raises(DataError, match="delivers no more images"):
        next(DeviceCamera(url(server, "/rubbish"), calibration).images(lambda: False))


def test_a_stream_that_ends_its_process_is_told(server: ThreadingHTTPServer, calibration: Path) -> None:
    camera = DeviceCamera(url(server, "/good"), calibration)
    images = camera.images(lambda: False)
    next(images)
    assert isinstance(camera._capture, OpenedStream)
    camera._capture._worker.kill()
    with pytest.raises(DataError, match="more memory or time"):
        next(images)


def test_options_of_the_user_stand_but_for_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(stream_worker.OPTIONS, "rtsp_transport;udp|protocol_whitelist;file")
    told = stream_worker.environment()[stream_worker.OPTIONS]
    assert told.startswith("rtsp_transport;udp|")
    assert told.endswith(f"|protocol_whitelist;{stream_worker.PROTOCOLS}")
    assert "file" not in stream_worker.PROTOCOLS

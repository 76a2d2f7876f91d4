"""Pictures of devices are decoded by processes of their own, which may die: the robot and others go on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import cv2
import numpy as np
import pytest
from helpers.waiting import until

from collabslam import Camera
from collabslam.live.decoding import view_image
from collabslam.live.pictures import WAITING, Pictures, Worker, WorkerDied
from collabslam.live.views import BROKEN, LiveView

CAMERA = Camera("pinhole", 64, 48, (50.0, 50.0, 32.0, 24.0))
GREY = np.random.default_rng(0).integers(0, 255, (48, 64)).astype(np.uint8)
PNG = cv2.imencode(".png", GREY)[1].tobytes()


class Heard:
    """What pictures become."""

    def __init__(self, cameras: dict[str, Camera]) -> None:
        self.views: list[LiveView] = []
        self.dropped: list[str] = []
        self.pictures = Pictures(cameras, self.views.append, lambda _, why: self.dropped.append(why))

    def take(self, session: str, image: bytes = PNG) -> None:
        self.pictures.take(session.partition("/")[0], LiveView(session, 0.0, image))

    @property
    def count(self) -> int:
        return len(self.views) + len(self.dropped)

    def worker(self, name: str) -> int:
        worker = self.pictures._devices[name]._worker
        assert worker is not None
        return worker._process._process.pid


def test_pixels_are_those_that_the_filter_would_make() -> None:
    heard = Heard({"": CAMERA})
    half = cv2.imencode(".jpg", GREY[::2, ::2])[1].tobytes()
    for image in (PNG, half):
        heard.take("anna/1", image)
        assert until(lambda n=heard.count: heard.count > n or heard.count == 2)
    assert until(lambda: len(heard.views) == 2)
    for view, image in zip(heard.views, (PNG, half), strict=True):
        assert view.pixels is not None
        np.testing.assert_array_equal(view.pixels, view_image(image, CAMERA))
        assert (view.session, view.image) == ("anna/1", image)
    heard.pictures.close()


def test_what_is_no_picture_is_dropped_before_the_filter() -> None:
    heard = Heard({"": CAMERA})
    tiff = cv2.imencode(".tif", GREY)[1].tobytes()
    for image in (b"", b"x", PNG[:-20], tiff, cv2.imencode(".png", GREY.T)[1].tobytes()):
        before = heard.count
        heard.take("anna/1", image)
        assert until(lambda n=before: heard.count > n)
    assert heard.dropped == [BROKEN] * 5
    heard.take("anna/1")
    assert until(lambda: heard.views)
    heard.pictures.close()


def test_a_worker_that_dies_costs_its_device_some_pictures() -> None:
    heard = Heard({"": CAMERA})
    heard.take("anna/1")
    assert until(lambda: heard.views)
    os.kill(heard.worker("anna"), signal.SIGKILL)
    for k in range(4):
        heard.take("anna/1")
        assert until(lambda n=k: heard.count == n + 2)
    assert heard.dropped == [BROKEN] * 3  # the one that it died of, and twice as many
    assert len(heard.views) == 2
    heard.pictures.close()


def test_nobody_waits_for_the_pictures_of_another() -> None:
    heard = Heard({"anna": CAMERA, "ben": CAMERA})
    heard.take("anna/1")
    assert until(lambda: heard.views)
    os.kill(heard.worker("anna"), signal.SIGSTOP)
    for _ in range(3 * WAITING):
        heard.take("anna/1")
    for k in range(5):
        heard.take("ben/1")
        assert until(lambda n=k: [v.session for v in heard.views].count("ben/1") > n)
    assert set(heard.dropped) == {"crowded"}
    assert 2 * WAITING - 1 <= len(heard.dropped) <= 2 * WAITING
    heard.pictures.close()
    heard.take("ben/1")  # of a robot that has ended


def test_strangers_start_no_workers() -> None:
    heard = Heard({"anna": CAMERA})
    for k in range(100):
        heard.take(f"eve{k}/1")
    assert heard.pictures._devices == {}
    assert len(heard.views) == 100  # the filter counts whose they are not
    assert all(view.pixels is None for view in heard.views)
    heard.pictures.close()


def test_workers_are_up_before_the_first_picture() -> None:
    heard = Heard({"anna": CAMERA, "ben": CAMERA})
    heard.pictures.wait()
    ready = {name: worker._process._process.pid for name, worker in heard.pictures._ready.items()}
    os.kill(ready["ben"], signal.SIGKILL)
    heard.pictures.wait()  # nor is one that died while it came up a fault
    heard.take("anna/1")
    heard.take("ben/1")
    assert until(lambda: len(heard.views) == 2)
    assert heard.dropped == []
    assert heard.worker("anna") == ready["anna"]
    assert heard.worker("ben") != ready["ben"]
    heard.pictures.close()


LIMITED = """
import sys
from collabslam.live import decode_worker as w
w.limit_memory(w.ROOM)
w.limit_time(w.CPU_SECONDS)
{}
print("done")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have other limits")
@pytest.mark.parametrize(
    ("what", "status"),
    [
        ("b'x' * 1000", 0),
        ("b'x' * (1 << 30)", 1),
        ("import numpy; numpy.ones(1 << 27)", 1),
        ("while True: pass", -signal.SIGXCPU),
    ],
)
def test_a_worker_has_limits(what: str, status: int) -> None:
    done = subprocess.run([sys.executable, "-c", LIMITED.format(what)], capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    assert ("done" in done.stdout) == (status == 0)


def test_a_picture_that_is_too_much_is_told() -> None:
    worker = Worker(CAMERA)
    assert worker.decode(PNG) is not None
    worker.kill()
    with pytest.raises(WorkerDied):
        worker.decode(PNG)
    worker.close()

"""Pictures of devices become pixels in a process of each device's own, before the filter hears of them.

A robot's frame waits for no picture, and one device's pictures do not wait for another's.  What is not
decoded never reaches the filter, nor its record: both stay the same to the bit.
"""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from collabslam._core import Camera
from collabslam.formats.worker_process import WorkerDied, WorkerProcess
from collabslam.live.views import BROKEN, LiveView
from collabslam.slam.worn.late_views import CROWDED
from collabslam.types import Image

WAITING = 4
"""Pictures of a device that wait; the oldest gives way."""
PATIENCE = 20.0
"""Seconds after which a worker that answers nothing is given up; its own limit is its processor time."""
LONGEST_REST = 1024
"""Pictures of a device that are not looked at, at most, after one that ended its worker."""


class Pictures:
    """Decodes the views of all devices; any thread may call `take`.

    The workers of the cameras are started at once, as one needs a second to come up; `wait` waits for them.

    Parameters
    ----------
    cameras : mapping
        Each Cf by its device's name, or of any device by "".
    give : callable
        Is given each view with its pixels, from a thread of its device's own.
    drop : callable
        Is told whose view is dropped, and why.
    """

    def __init__(
        self,
        cameras: Mapping[str, Camera],
        give: Callable[[LiveView], None],
        drop: Callable[[str, str], None],
    ) -> None:
        self._cameras, self._give, self._drop = dict(cameras), give, drop
        self._lock = threading.Lock()
        self._devices: dict[str, _Device] = {}
        self._ready = {name: Worker(camera) for name, camera in self._cameras.items()}
        self._closed = False

    def wait(self) -> None:
        """Until the workers are up, before any view is taken; one that does not come up is done without."""
        for name in [name for name, worker in self._ready.items() if not worker.is_up()]:
            self._ready.pop(name).close()

    def take(self, name: str, view: LiveView) -> None:
        """A view of a device; of nobody's whose camera is known it goes on as it is."""
        known = name if name in self._cameras else ""
        camera = self._cameras.get(known)
        if camera is None or not isinstance(view.image, bytes):
            self._give(view)
            return
        with self._lock:
            if self._closed:
                return
            if name not in self._devices:
                worker, drop = self._ready.pop(known, None), partial(self._drop, name)
                self._devices[name] = _Device(camera, self._give, drop, worker)
            device = self._devices[name]
        device.add(view)

    def close(self) -> None:
        """End all workers; what waits is not decoded."""
        with self._lock:
            self._closed = True
            devices, self._devices = list(self._devices.values()), {}
            ready, self._ready = list(self._ready.values()), {}
        for device in devices:
            device.close()
        for worker in ready:
            worker.close()


class _Device:
    """One device's thread, and its worker: ``worker`` if one is ready."""

    def __init__(
        self,
        camera: Camera,
        give: Callable[[LiveView], None],
        drop: Callable[[str], None],
        worker: Worker | None,
    ) -> None:
        self._camera, self._give, self._drop = camera, give, drop
        self._waiting: deque[LiveView] = deque()
        self._change = threading.Condition()
        self._ended = False
        self._worker = worker
        self._rest, self._deaths = 0, 0
        self._thread = threading.Thread(target=self._work, name="pictures", daemon=True)
        self._thread.start()

    def add(self, view: LiveView) -> None:
        with self._change:
            if len(self._waiting) >= WAITING:
                self._waiting.popleft()
                self._drop(CROWDED)
            self._waiting.append(view)
            self._change.notify()

    def close(self) -> None:
        with self._change:
            self._ended = True
            self._change.notify()
        if self._worker is not None:
            self._worker.kill()
        self._thread.join()

    def _work(self) -> None:
        while (view := self._next()) is not None:
            pixels = self._decoded(view)
            if pixels is None:
                self._drop(BROKEN)
            else:
                self._give(replace(view, pixels=pixels))
        if self._worker is not None:
            self._worker.close()

    def _next(self) -> LiveView | None:
        with self._change:
            while not self._waiting and not self._ended:
                self._change.wait()
            return None if self._ended else self._waiting.popleft()

    def _decoded(self, view: LiveView) -> Image | None:
        """The pixels; None of what is none, and for a while after a picture that ended the worker."""
        assert isinstance(view.image, bytes)
        if self._rest > 0:
            self._rest -= 1
            return None
        if self._worker is None:
            self._worker = Worker(self._camera)
        try:
            pixels = self._worker.decode(view.image)
            self._deaths = 0 if pixels is not None else self._deaths
        except WorkerDied:
            self._worker.close()
            self._worker = None
            self._deaths += 1
            self._rest = min(2**self._deaths, LONGEST_REST)
            return None
        return pixels


class Worker:
    """A process that decodes pictures of one camera, see `decode_worker`.

    Parameters
    ----------
    camera : Camera
    """

    def __init__(self, camera: Camera) -> None:
        self._shape = camera.height, camera.width
        self._process = WorkerProcess("collabslam.live.decode_worker", json.dumps(camera.__getnewargs__()))

    def decode(self, data: bytes) -> Image | None:
        """The pixels (H, W) in the camera's size; None if the picture is refused.

        Raises
        ------
        WorkerDied
            If it took more memory or time than it may.
        """
        pixels = self._process.ask(data, PATIENCE)
        if not pixels:
            return None
        if len(pixels) != self._shape[0] * self._shape[1]:
            raise WorkerDied
        return np.frombuffer(pixels, np.uint8).reshape(self._shape)

    def is_up(self) -> bool:
        """Whether it answers; waits for that."""
        try:
            self.decode(b"")
        except WorkerDied:
            return False
        return True

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()

    def close(self) -> None:
        """End the process, and wait for that."""
        self._process.close()

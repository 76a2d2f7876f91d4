"""The wearable's end: images of Cf go to the robot, small and stamped, with Cf's pose where it is known."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from collabslam._core import Camera
from collabslam.errors import DataError, InputError
from collabslam.live import link, messages, names
from collabslam.live.advice import OwnImages
from collabslam.live.clock import ClockEstimator, Exchange
from collabslam.live.monotonic_clock import MonotonicClock
from collabslam.live.pace import Encoder, Pace, Transport
from collabslam.types import Array, Image
from collabslam.worn_pose import AhrsReading, LaserScan
from collabslam.worn_pose.readings import Wearer

BEATS = (0.015, 0.030, 0.060)
"""Seconds after an image at which empty messages follow it where it goes by TLS: only when something came
after a lost packet does TCP know of the loss at once; otherwise it waits for its timer, 0.2 s and more."""
ATTITUDES = 30.0
"""Attitudes of each AHRS that are sent per second; the robot interpolates between them."""
ASK_EVERY, ASK_FIRST, SOON = 0.5, 0.1, 20
"""Seconds between two questions for the robot's time, and between the first `SOON` of them."""


class WornDevice:
    """Sends views; a context manager that opens its threads and closes them.

    Parameters
    ----------
    session
        An open Zenoh session.
    name : str
        Of the device, as in its certificate.
    camera : Camera
        Calibration of Cf.
    clock : MonotonicClock
        By which views are stamped.
    tell : callable, optional
        Is given a line of what becomes of the images, again and again.
    """

    def __init__(
        self,
        session: Any,
        name: str,
        camera: Camera,
        clock: MonotonicClock,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._tell, self._own = tell, OwnImages()
        self.pace, self.transport = Pace(), Transport()
        self.robot_clock = ClockEstimator()
        self.sent = 0
        self.session = names.new_session(names.device_name(name))
        self._zenoh, self._name, self._camera, self._clock = session, name, camera, clock
        self._encoder = Encoder()
        self._last_attitude: dict[Wearer, float] = {}
        self._info = messages.camera_info(0.0, self.session, camera)
        self._ended = threading.Event()
        self._known = threading.Event()
        self._out = {
            part: link.publisher(session, names.key(name, part), urgent=part == names.EXCHANGE)
            for part in names.PARTS
        }
        self._datagrams = {
            part: link.publisher(session, names.key(name, part), datagrams=True)
            for part in (names.IMAGE, names.T_CF, names.RATE, names.ATTITUDE, names.ROBOT_ATTITUDE)
        }
        self._status = link.subscriber(session, names.STATUS, self._heard)
        self._sent_at = threading.Condition()
        self._threads = [
            threading.Thread(target=work, name=name, daemon=True)
            for name, work in (("clock", self._ask), ("beat", self._beat))
        ]

    def __enter__(self) -> WornDevice:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        with self._sent_at:
            self._sent_at.notify_all()
        for thread in self._threads:
            thread.join()

    def send(
        self,
        t: float,
        image: Image,
        pose: tuple[Array, Array] | None = None,
        rate: Array | None = None,
    ) -> None:
        """An image of Cf taken at ``t`` seconds by the clock; T_CF and its covariance, and how Cf turned
        (rad/s along its axes), where known."""
        jpeg = self._encoder.encode(image, self.pace.level.size)
        out = self._datagrams if self.transport.datagrams(self.sent) else self._out
        if pose is not None:
            out[names.T_CF].put(messages.pose(t, "cs_optical", *pose))
        if rate is not None:
            out[names.RATE].put(messages.rate(t, rate, frame=self.session))
        out[names.IMAGE].put(messages.compressed_image(t, self.session, jpeg))
        with self._sent_at:
            self.sent += 1
            self._sent_at.notify_all()

    def reading(self, reading: AhrsReading) -> None:
        """An attitude of Cf, or of the robot where this device hears its sensors, by this device's clock."""
        last = self._last_attitude.get(reading.where, -float("inf"))
        if 0.0 <= reading.t - last < 0.9 / ATTITUDES:
            return
        self._last_attitude[reading.where] = reading.t
        part = names.ATTITUDE if reading.where == "worn" else names.ROBOT_ATTITUDE
        out = self._datagrams if self.transport.datagrams(self.sent) else self._out
        out[part].put(messages.attitude(reading.t, self.session, reading.q_xyzw))

    def scan(self, scan: LaserScan) -> None:
        """A scan of one of the robot's scanners, where this device hears it, by this device's clock."""
        frame = f"{self.session}/{scan.scanner}"
        self._out[names.SCAN].put(messages.scan(scan.t, frame, scan))

    def behind(self, t: float) -> float:
        """Seconds by which the robot's time is past ``t``; InputError before anything is known of it."""
        now = self._clock.now()
        return now - self.stamp_at(t, now)

    def stamp_at(self, t: float, now: float) -> float:
        """What the device's clock shows at the robot's time ``t``, near its own ``now``; raises likewise."""
        found = self.robot_clock.robot_time(now)
        if found is None:
            raise InputError("The robot's time is not known yet; wait for it with wait_for_robot.")
        return now - (found[0] - t)

    def wait_for_robot(self, seconds: float) -> bool:
        """Whether the robot's time is known, waited for so long."""
        return self._known.wait(seconds)

    def _beat(self) -> None:
        """Empty messages after each image; a newer image makes up for those that are left."""
        done = 0
        while not self._ended.is_set():
            with self._sent_at:
                if self.sent == done:
                    self._sent_at.wait(0.5)
                if self.sent == done:
                    continue
                done = self.sent
            if self.transport.datagrams(done) and link.has_datagrams(self._zenoh):
                continue
            before = 0.0
            for at in BEATS:
                self._ended.wait(at - before)
                before = at
                self._out[names.BEAT].put(b"")

    def _ask(self) -> None:
        """Asks for the robot's time for as long as the device is open, and tells what came back."""
        asked = 0
        while not self._ended.is_set():
            self._out[names.CAMERA_INFO].put(self._info) if asked % SOON < 2 else None
            exchange = self._exchange()
            if exchange is not None:
                self.robot_clock.add(exchange)
                self._out[names.EXCHANGE].put(messages.exchange(self.session, exchange))
                self._known.set()
            else:
                self._tell(f"{self.sent} images sent. No robot answers.")
            asked += 1
            self._ended.wait(ASK_FIRST if asked < SOON else ASK_EVERY)

    def _exchange(self) -> Exchange | None:
        """One question and its answer; None if there was none."""
        sent = self._clock.now()
        found = None
        for reply in self._zenoh.get(names.CLOCK, timeout=1.0):
            returned = self._clock.now()
            if reply.ok is not None and found is None:
                try:
                    _, (received, answered) = messages.times_from(bytes(reply.ok.payload.to_bytes()), 2)
                except DataError:
                    continue
                found = Exchange(sent, received, answered, returned)
        return found

    def _heard(self, key: str, payload: bytes) -> None:
        """The robot's status: how old this device's images are."""
        try:
            own = messages.status_from(payload).get(self._name)
            if own is not None:
                images = float(own["images"])
                self._tell(f"{self.sent} images sent. {self._own.report(own)[0]}")
                self.transport.report(self._clock.now(), self.sent, int(images))
                if "age_median_ms" in own:
                    self.pace.report(float(own["age_median_ms"]) / 1e3, images)
        except (DataError, KeyError, ValueError):
            pass  # a robot of another version: the pace stays

"""Between the pages and the robot's link: a phone becomes a device, the robot's messages become facts."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.errors import DataError, InputError
from collabslam.geometry import pose_from_quaternion
from collabslam.live import link, messages, names
from collabslam.live.advice import OwnImages
from collabslam.live.clock import ClockEstimator, Exchange
from collabslam.live.monotonic_clock import MonotonicClock
from collabslam.live.pace import Pace
from collabslam.slam.worn.view_planning import DIAGNOSTICS
from collabslam.types import Array

WIDTHS = {10_000: (480, 0.5), 7_000: (400, 0.45), 5_000: (320, 0.4)}
"""What a browser is asked for to make images of about so many bytes: width in pixels, JPEG quality."""
TRACKED_SD = (0.005, np.deg2rad(0.2))
"""Standard deviations of where a phone's tracking (WebXR) says that an image was taken, beside its drift:
metres of each coordinate, radians about each axis.  WebXR tells none; these are assumed."""
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""From WebXR's camera (y up, looking along -z) to ours."""
LARGEST_SIDE = 4096
"""Pixels of a side of an image."""
MAP_POINTS, TRAJECTORY = 400, 2000
"""Points of the map, and of the way, that a page is told."""
BEAT = 0.5
"""Seconds after which a page is told how old everything is, if nothing else."""
AGED = ("status", "point", "persons", "map")
"""Facts whose ages a page is told, beside the picture's."""
CAMERA_EVERY = 1.0
"""Seconds between two times that a phone's calibration is told before it sends."""
GONE = 5.0
"""Seconds after which the place of a worn camera that is not measured any more is not shown."""


class Gateway:
    """A device of the link that pages use.

    Parameters
    ----------
    session
        An open Zenoh session.
    name : str
        Of the device, as in its certificate.
    camera : Camera or None
        The phone's calibration; without it phones are refused.
    """

    def __init__(self, session: Any, name: str, camera: Camera | None) -> None:
        self._zenoh, self._name, self._camera = session, names.device_name(name), camera
        self._out = {part: link.publisher(session, names.key(name, part)) for part in names.PARTS}
        self.pace = Pace()
        self.robot_clock = ClockEstimator()
        self.clock = MonotonicClock()
        self._taken = threading.Lock()
        self._change = threading.Condition()
        self._facts: dict[str, tuple[int, Any]] = {}
        self._came: dict[str, float] = {}  # when each kind of fact came last
        self._told_camera = -float("inf")
        self._trajectory: list[list[float]] = []
        self._persons: dict[str, tuple[float, list[float]]] = {}
        self._own = OwnImages()
        self._count = 0
        self._picture: tuple[int, bytes] = (0, b"")
        self._heard = [
            link.subscriber(session, key, take)
            for key, take in (
                (names.STATUS, self._status),
                (names.POSE, self._pose),
                (names.MAP, self._map),
                (names.VIEW, self._view),
                (f"{names.WORN_POSE}/**", self._worn_pose),
            )
        ]

    @contextlib.contextmanager
    def phone(self, width: Any, height: Any, intrinsics: Any = None) -> Iterator[Phone]:
        """A phone that sends; only one at a time.

        Parameters
        ----------
        width, height
            Of its images, pixels, as it says.
        intrinsics
            fx, fy, cx, cy of an image that it has rectified itself, as WebXR's have it; then `camera` is not
            needed.
        """
        mine = self._taken.acquire(blocking=False)
        told = None if intrinsics is None else _pinhole(width, height, intrinsics)
        try:
            if mine and told is not None:
                yield Phone(self, "", told)
            elif mine and intrinsics is not None:
                yield Phone(self, "The phone tells no calibration that can be; use its plain camera.", None)
            else:
                yield Phone(self, self._why_not(width, height, mine=mine), self._camera)
        finally:
            if mine:
                self._taken.release()

    @contextlib.contextmanager
    def watching(self) -> Iterator[Watch]:
        """What a page is told from now on."""
        yield Watch(self)

    def publish(self, part: str, payload: bytes) -> None:
        """Write below the device's own name."""
        self._out[part].put(payload)

    def announce(self) -> None:
        """Tell the robot the phone's calibration: it may wait for that before it looks at anything."""
        now = time.monotonic()
        with self._change:
            if self._camera is None or now - self._told_camera < CAMERA_EVERY:
                return
            self._told_camera = now
        self.publish(names.CAMERA_INFO, messages.camera_info(0.0, "", self._camera))

    @property
    def name(self) -> str:
        """Of the device."""
        return self._name

    def new_session(self) -> str:
        """A name for a phone that has just connected."""
        return names.new_session(self._name)

    def ask(self) -> None:
        """One question for the robot's time, of the gateway's own clock."""
        sent = self.clock.now()
        for reply in self._zenoh.get(names.CLOCK, timeout=1.0):
            returned = self.clock.now()
            if reply.ok is not None:
                with contextlib.suppress(DataError):
                    _, (received, answered) = messages.times_from(bytes(reply.ok.payload.to_bytes()), 2)
                    self.robot_clock.add(Exchange(sent, received, answered, returned))
                return

    def _why_not(self, width: Any, height: Any, *, mine: bool) -> str:
        if not mine:
            return "Another phone is the worn camera; close its page first."
        if self._camera is None:
            return "The phone's calibration is missing; start 'collabslam live web' with --camera FILE."
        wide, high = self._camera.width, self._camera.height
        if not (isinstance(width, int) and isinstance(height, int) and width * high == height * wide):
            return (
                f"The phone's images are {width} x {height}, its calibration is for {wide} x {high}: hold "
                "the phone as it was calibrated, or calibrate this size."
            )
        return ""

    def _status(self, key: str, payload: bytes) -> None:
        with contextlib.suppress(DataError, KeyError, ValueError):
            found = messages.status_from(payload)
            robot = found["robot"]
            own = found.get(self._name, {})
            if "age_median_ms" in own:
                self.pace.report(float(own["age_median_ms"]) / 1e3, float(own["images"]))
            if own:
                text, good = self._own.report(own)
                self._tell(own={"text": text, "good": good})
            facts = {k.replace("_", " "): v for k, v in robot.items() if k != "message"}
            for name in sorted(found.keys() - {"robot"}):
                said = {k.replace("_", " "): v for k, v in found[name].items() if k != "message"}
                if found[name]["message"]:
                    said["link"] = found[name]["message"]
                facts |= {f"{name}: {k}": v for k, v in said.items()}
            facts |= {k.replace("_", " "): v for k, v in own.items() if k in DIAGNOSTICS}
            self._tell(facts=facts, status=robot["message"], link=robot.get("link", ""))

    def _pose(self, key: str, payload: bytes) -> None:
        with contextlib.suppress(DataError):
            _, pose, covariance = messages.pose_from(payload, key)
            place = seen_from_above(pose, covariance)
            with self._change:
                self._trajectory = [*self._trajectory[-TRAJECTORY:], place]
            self._tell(point=place)

    def _worn_pose(self, key: str, payload: bytes) -> None:
        """Where a worn camera is, of several persons by name."""
        with contextlib.suppress(DataError):
            _, pose, covariance = messages.pose_from(payload, key)
            name = key.removeprefix(names.WORN_POSE).removeprefix("/")
            now = time.monotonic()
            seen = {n: of for n, of in self._persons.items() if now - of[0] <= GONE}
            self._persons = seen | {name: (now, seen_from_above(pose, covariance))}
            self._tell(persons={n: place for n, (_, place) in self._persons.items()})

    def _map(self, key: str, payload: bytes) -> None:
        with contextlib.suppress(DataError):
            points = messages.cloud_from(payload)[0][:MAP_POINTS]
            self._tell(map=np.round(points[:, [0, 2]], 3).tolist())

    def _view(self, key: str, payload: bytes) -> None:
        with contextlib.suppress(DataError):
            data = messages.decoded(messages.COMPRESSED, payload).data.tobytes()
            with self._change:
                self._picture = (self._picture[0] + 1, data)
                self._came["picture"] = time.monotonic()
                self._change.notify_all()

    def _tell(self, **facts: Any) -> None:
        """Facts that came just now from the robot."""
        with self._change:
            self._count += 1
            self._facts |= {name: (self._count, value) for name, value in facts.items()}
            self._came |= dict.fromkeys(facts.keys() & AGED, time.monotonic())
            self._change.notify_all()


class Watch:
    """What one page has been told, and what it has not."""

    def __init__(self, gateway: Gateway) -> None:
        self._of = gateway
        self._count, self._picture = -1, 0

    def next(self) -> tuple[dict[str, Any], bytes | None]:
        """Waits for something new, at most `BEAT` seconds; what is new, and the picture if it is another one.

        ``ages`` is always there: seconds since the robot told each of `AGED`, and since its last picture, of
        those that ever came.
        """
        of, until = self._of, time.monotonic() + BEAT
        with of._change:
            while of._count == self._count and of._picture[0] == self._picture:
                left = until - time.monotonic()
                if left <= 0.0 or not of._change.wait(left):
                    break
            facts = {name: value for name, (count, value) in of._facts.items() if count > self._count}
            if of._trajectory and self._count < 0:
                facts["trajectory"] = list(of._trajectory)
            self._count = of._count
            number, data = of._picture
            now = time.monotonic()
            facts["ages"] = {name: round(now - came, 2) for name, came in sorted(of._came.items())}
        picture = data if number != self._picture else None
        self._picture = number
        return facts, picture


class Phone:
    """A phone while its page is open.

    Attributes
    ----------
    refused : str
        Why it cannot be the worn camera; empty if it can.
    """

    def __init__(self, gateway: Gateway, refused: str, camera: Camera | None) -> None:
        self.refused, self._camera = refused, camera
        self._of = gateway
        self._session = gateway.new_session()
        self._asked = 0

    def image(self, t: float, jpeg: bytes) -> None:
        """A JPEG taken at ``t`` seconds by the phone's clock."""
        self._of.publish(names.IMAGE, messages.compressed_image(t, self._session, jpeg))

    def own(self, t: float, place: Array, q_xyzw: Array) -> None:
        """Where the phone's tracking has its camera (WebXR's axes) as it takes the image of ``t`` seconds."""
        with contextlib.suppress(ValueError):
            t_xf = pose_from_quaternion(place, q_xyzw[[3, 0, 1, 2]]) @ _FLIP
            covariance = np.diag(np.repeat(np.square(TRACKED_SD), 3))
            self._of.publish(names.OWN, messages.pose(t, self._session, t_xf, covariance))

    def rate(self, t: float, rate: Array) -> None:
        """How the phone turns at ``t`` seconds by its clock: (3,) rad/s along the axes of its camera."""
        self._of.publish(names.RATE, messages.rate(t, rate, frame=self._session))

    def exchange(self, found: Exchange) -> None:
        """What the phone's clock said to the gateway's; the robot is told it in its own time."""
        of = self._of
        if self._asked % 10 == 0 and self._camera is not None:
            of.publish(names.CAMERA_INFO, messages.camera_info(0.0, self._session, self._camera))
        self._asked += 1
        of.ask()
        there, back = (of.robot_clock.robot_time(t) for t in (found.received, found.answered))
        if found.possible and there is not None and back is not None:
            whole = Exchange(found.sent, there[0], back[0], found.returned)
            of.publish(names.EXCHANGE, messages.exchange(self._session, whole))

    def level(self) -> Mapping[str, float]:
        """What the browser is to send now."""
        level = self._of.pace.level
        width, quality = WIDTHS[level.size]
        return {"width": width, "quality": quality, "rate": level.rate}


def _pinhole(width: Any, height: Any, intrinsics: Any) -> Camera | None:
    """The calibration that a phone tells; None if there can be no such."""
    sizes = all(isinstance(n, int) and 0 < n <= LARGEST_SIDE for n in (width, height))
    numbers = isinstance(intrinsics, list) and all(isinstance(v, int | float) for v in intrinsics)
    if not sizes or not numbers or len(intrinsics) != 4:
        return None
    try:
        fx, fy, cx, cy = map(float, intrinsics)
        return Camera("pinhole", width, height, (fx, fy, cx, cy))
    except (InputError, ValueError, OverflowError):
        return None


def seen_from_above(pose: Array, covariance: Array) -> list[float]:
    """x and z of a position in W (metres), then the standard deviations along their axes and their angle, and
    the angle to which the camera looks, from x to z."""
    turn = pose[:3, :3]
    flat = (turn @ covariance[:3, :3] @ turn.T)[np.ix_([0, 2], [0, 2])]
    values, vectors = np.linalg.eigh(flat)
    sd = np.sqrt(np.clip(values, 0.0, None))
    angle = float(np.arctan2(vectors[1, 1], vectors[0, 1]))
    heading = float(np.arctan2(turn[2, 2], turn[0, 2]))
    numbers = (pose[0, 3], pose[2, 3], sd[1], sd[0], angle, heading)
    return [round(float(v), 4) for v in numbers]

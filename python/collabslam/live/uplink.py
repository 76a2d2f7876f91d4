"""What devices write, as events for the filter; what is broken, or too much, costs its sender only."""

from __future__ import annotations

import statistics
import threading
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from collabslam._core import Camera
from collabslam.errors import CollabslamError
from collabslam.live import messages, names
from collabslam.live.clock import ClockEstimator
from collabslam.live.core import ClockReading, Event
from collabslam.live.views import LiveView
from collabslam.types import Array

UNPAIRED, MALFORMED, FLOOD, CALIBRATION, STRANGER = (
    "no pose",
    "malformed",
    "too many",
    "other calibration",
    "too many devices",
)
"""Why a message was dropped before the filter."""
WAITING, DEVICES = 8, 16
"""Images, and poses, of a device that wait for each other; devices that are listened to."""
RATES = {names.IMAGE: 60.0, names.T_CF: 200.0, names.CAMERA_INFO: 5.0, names.EXCHANGE: 20.0}
"""Messages per second of each kind that a device may write."""
REMEMBERED = 1000
"""Arrivals of images that are remembered of each device."""
BURST = 30.0
"""Messages of each kind that may come at once, after the network held them back."""


Value = TypeVar("Value")


@dataclass(frozen=True)
class Arrival:
    """An image's stamp by the device's clock; when it was taken and when it came, by the robot's, seconds."""

    stamp: float
    taken: float
    came: float

    @property
    def age(self) -> float:
        """Seconds that it had on its way."""
        return self.came - self.taken


@dataclass(frozen=True)
class _Image:
    session: str
    stamp: float
    data: bytes


@dataclass
class _Device:
    """What is known of one device."""

    camera: Camera | None = None
    images: OrderedDict[float, _Image] = field(default_factory=OrderedDict)
    poses: OrderedDict[float, tuple[Array, Array]] = field(default_factory=OrderedDict)
    allowed: dict[str, tuple[float, float]] = field(default_factory=dict)  # messages left, at a time
    clock: ClockEstimator = field(default_factory=ClockEstimator)
    session: str = ""
    arrivals: deque[Arrival] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    images_received: int = 0


class Uplink:
    """Makes events of the messages of all devices.  Any thread may call `take`.

    Parameters
    ----------
    push : callable
        Is given each event.
    now : callable
        The robot's time, seconds.
    """

    def __init__(self, push: Callable[[Event], None], now: Callable[[], float]) -> None:
        self.dropped: Counter[str] = Counter()
        """Messages by the reason why they were dropped."""
        self.received: Counter[str] = Counter()
        """Bytes by device."""
        self.faults: deque[str] = deque(maxlen=8)
        """The last refusals in words."""
        self._push, self._now = push, now
        self._lock = threading.Lock()
        self._devices: dict[str, _Device] = {}
        self._camera: Camera | None = None
        self._known = threading.Event()

    def use(self, camera: Camera) -> None:
        """From now on only views of this calibration are taken."""
        self._camera = camera

    def calibration(self, seconds: float) -> Camera | None:
        """The calibration of the first device that tells one, waited for so long; None if none did."""
        self._known.wait(seconds)
        with self._lock:
            return next((d.camera for d in self._devices.values() if d.camera is not None), None)

    def arrivals(self, name: str) -> list[Arrival]:
        """The last images of a device."""
        with self._lock:
            return list(self._devices[name].arrivals) if name in self._devices else []

    def reports(self) -> dict[str, dict[str, float]]:
        """Of each device: images received, their last age and the median of the last ten, milliseconds."""
        with self._lock:
            return {
                name: {
                    "images": device.images_received,
                    "age_ms": 1e3 * device.arrivals[-1].age,
                    "age_median_ms": 1e3 * statistics.median(a.age for a in list(device.arrivals)[-10:]),
                    "clock_drift_ppm": 1e6 * device.clock.drift,
                }
                for name, device in self._devices.items()
                if device.arrivals
            }

    def take(self, key: str, payload: bytes) -> None:
        """A message of a device; never raises."""
        name, part = names.device_of(key)
        with self._lock:
            self.received[name] += len(payload)
            if name not in self._devices:
                if len(self._devices) >= DEVICES:
                    self.dropped[STRANGER] += 1
                    return
                self._devices[name] = _Device()
            device = self._devices[name]
            if part not in RATES or not _allowed(device, part, time.monotonic()):
                self.dropped[FLOOD if part in RATES else MALFORMED] += 1
                return
            try:
                event = self._event(name, device, part, payload)
            except CollabslamError as error:
                self.dropped[MALFORMED] += 1
                self.faults.append(f"{key}: {error}")
                return
        if event is not None:
            try:
                self._push(event)
            except CollabslamError as error:  # the filter has ended: its own thread says so
                self.faults.append(str(error))

    def _event(self, name: str, device: _Device, part: str, payload: bytes) -> Event | None:
        if part == names.EXCHANGE:
            session, exchange = messages.exchange_from(payload)
            session = _own(name, session)
            if session != device.session:
                device.session, device.clock = session, ClockEstimator()
            device.clock.add(exchange)
            return ClockReading(session, exchange)
        if part == names.CAMERA_INFO:
            device.camera = messages.camera_from(payload, f"the device {name}")
            self._known.set()
            return None
        if part == names.IMAGE:
            message = messages.decoded(messages.COMPRESSED, payload)
            stamp = messages.stamp_of(message)
            session = _own(name, str(message.header.frame_id))
            image = _Image(session, stamp, message.data.tobytes())
            device.images_received += 1
            if (taken := device.clock.robot_time(stamp)) is not None:
                device.arrivals.append(Arrival(stamp, taken[0], self._now()))
            self.dropped[UNPAIRED] += _keep(device.images, stamp, image)
        else:
            stamp, t_cf, covariance = messages.pose_from(payload, f"the device {name}")
            _keep(device.poses, stamp, (t_cf, covariance))
        return self._pair(device, stamp)

    def _pair(self, device: _Device, stamp: float) -> Event | None:
        """The view of a stamp, when both its image and its pose are there."""
        if stamp not in device.images or stamp not in device.poses:
            return None
        image, (t_cf, covariance) = device.images.pop(stamp), device.poses.pop(stamp)
        if self._camera is not None and device.camera is not None and not _same(device.camera, self._camera):
            self.dropped[CALIBRATION] += 1
            return None
        return LiveView(image.session, stamp, image.data, t_cf, covariance)


def _same(a: Camera, b: Camera) -> bool:
    """Whether two calibrations are one as messages state them."""
    return messages.camera_info(0.0, "", a) == messages.camera_info(0.0, "", b)


def _allowed(device: _Device, part: str, now: float) -> bool:
    """Whether one more message of a kind is within its rate."""
    left, then = device.allowed.get(part, (BURST, now))
    left = min(BURST, left + (now - then) * RATES[part])
    device.allowed[part] = (max(0.0, left - 1.0), now)
    return left >= 1.0


def _own(name: str, session: str) -> str:
    """A session's name: whatever a device calls it, it is the device's own."""
    return f"{name}/{session.rpartition('/')[2][:32]}"


def _keep(waiting: OrderedDict[float, Value], stamp: float, value: Value) -> bool:
    """Lets one more wait; True if the oldest had to give way."""
    waiting[stamp] = value
    if len(waiting) <= WAITING:
        return False
    waiting.popitem(last=False)
    return True

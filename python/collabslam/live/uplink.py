"""What devices write, as events for the filter; what is broken, or too much, costs its sender only."""

from __future__ import annotations

import statistics
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from collabslam._core import Camera
from collabslam.errors import CollabslamError, DataError
from collabslam.live import messages, names
from collabslam.live.advice import DROPPED
from collabslam.live.clock import ClockEstimator
from collabslam.live.core import ClockReading, Event
from collabslam.live.pairing import Pairing
from collabslam.live.pictures import Pictures
from collabslam.live.sensed import reading_from, scan_from
from collabslam.live.sensing import Sensing
from collabslam.live.views import NO_CLOCK, LiveView, OwnPose, sender_of
from collabslam.types import Array
from collabslam.worn_pose import WornPoseConfig
from collabslam.worn_pose.readings import Wearer

UNPAIRED, MALFORMED, FLOOD, CALIBRATION, STRANGER, UNASKED = (
    "no pose",
    "malformed",
    "too many",
    "other calibration",
    "too many devices",
    "no sensors file",
)
"""Why a message was dropped before the filter."""
STRANGERS = 16
"""Devices that are listened to where no keys say who may speak."""
RATES = {
    names.IMAGE: 60.0,
    names.T_CF: 200.0,
    names.CAMERA_INFO: 5.0,
    names.EXCHANGE: 20.0,
    names.BEAT: 200.0,
    names.ATTITUDE: 400.0,
    names.ROBOT_ATTITUDE: 400.0,
    names.SCAN: 200.0,
    names.OWN: 60.0,
    names.RATE: 250.0,
}
"""Messages per second of each kind that a device may write."""
MOST_BEAMS = 4000
"""Beams of a scan."""
SENSORS = {
    names.ATTITUDE: messages.IMU,
    names.ROBOT_ATTITUDE: messages.IMU,
    names.SCAN: messages.SCAN,
}
"""What sensors tell, and its type."""
REMEMBERED = 1000
"""Arrivals of images that are remembered of each device."""
LONGEST = 300
"""Characters of a refusal: what it quotes may be a hostile sender's."""
BURST = 30.0
"""Messages of each kind that may come at once, after the network held them back."""


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


@dataclass
class _Device:
    """What is known of one device."""

    pairing: Pairing
    camera: Camera | None = None
    allowed: dict[str, tuple[float, float]] = field(default_factory=dict)  # messages left, at a time
    clock: ClockEstimator = field(default_factory=ClockEstimator)
    session: str = ""
    arrivals: deque[Arrival] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    images_received: int = 0
    dropped: Counter[str] = field(default_factory=Counter)


class Uplink:
    """Makes events of the messages of all devices.  Any thread may call `take`.

    Parameters
    ----------
    push : callable
        Is given each event.
    now : callable
        The robot's time, seconds.
    unposed : bool
        Whether images without T_CF are of use.
    sensors : WornPoseConfig, optional
        Of the sensors that tell T_CF; what they say then waits in `sensing`.
    devices : sequence of str, optional
        Who may speak; without it anybody, and at most `STRANGERS` of them.
    awaited : sequence of str
        Who has a place beside as many strangers as there may be.
    """

    def __init__(
        self,
        push: Callable[[Event], None],
        now: Callable[[], float],
        *,
        unposed: bool = False,
        sensors: WornPoseConfig | None = None,
        devices: Sequence[str] | None = None,
        awaited: Sequence[str] = (),
    ) -> None:
        self.sensing = None if sensors is None else Sensing(sensors, self._posed)
        self.dropped: Counter[str] = Counter()
        """Messages by the reason why they were dropped."""
        self.received: Counter[str] = Counter()
        """Bytes by device that is listened to."""
        self.pictures: Pictures | None = None
        """Decodes views before they are given; without it they are given as they come."""
        self.faults: deque[str] = deque(maxlen=8)
        """The last refusals in words."""
        self._push, self._now, self._unposed = push, now, unposed
        self._lock = threading.Lock()
        self._devices: dict[str, _Device] = {}
        self._known = None if devices is None else frozenset(devices)
        self._awaited = frozenset(awaited)
        self._cameras: dict[str, Camera] = {}
        self._told = threading.Event()

    def use(self, cameras: Mapping[str, Camera]) -> None:
        """From now on only views of these calibrations are taken: of each device's own, or of "", all's."""
        self._cameras = dict(cameras)

    def calibrations(self, names: Iterable[str], seconds: float) -> dict[str, Camera]:
        """The calibrations that devices of these names have told, waited for so long; "" is any device."""
        self._told.wait(seconds)
        with self._lock:
            self._told.clear()
            told = {name: d.camera for name, d in self._devices.items() if d.camera is not None}
            found = {name: told.get(name) if name else next(iter(told.values()), None) for name in names}
            return {name: camera for name, camera in found.items() if camera is not None}

    def counts(self) -> dict[str, int]:
        """Everything that was dropped, by reason."""
        with self._lock:
            unpaired = sum(d.pairing.unpaired for d in self._devices.values())
            return {k: v for k, v in (*self.dropped.items(), (UNPAIRED, unpaired)) if v}

    def unposed(self) -> dict[str, int]:
        """Why the sensors did not tell T_CF, and how often."""
        return {} if self.sensing is None else dict(self.sensing.reasons)

    def said(self) -> dict[str, str]:
        """The last refusal in words, if any."""
        with self._lock:
            return {"last refusal": self.faults[-1]} if self.faults else {}

    def arrivals(self, name: str) -> list[Arrival]:
        """The last images of a device."""
        with self._lock:
            return list(self._devices[name].arrivals) if name in self._devices else []

    def reports(self) -> dict[str, dict[str, float]]:
        """Of each device: images received, their last age and the median of the last ten, milliseconds; how
        long ago the last one came, seconds; what was dropped, by reason.

        One of which none has arrived is told so: it has to know that its way loses all.
        """
        with self._lock:
            return {name: _report(device, self._now()) for name, device in self._devices.items()}

    def take(self, key: str, payload: bytes) -> None:
        """A message of a device; never raises."""
        with self._lock:
            try:
                name, part = names.device_of(key)
            except DataError as error:
                self._refuse(None, "", error)
                return
            device = self._device(name)
            if device is None:
                self.dropped[STRANGER] += 1
                return
            self.received[name] += len(payload)
            if not _allowed(device, part, time.monotonic()):
                self._drop(device, FLOOD)
                return
            try:
                if part in SENSORS:
                    then = self._sensed(name, device, part, payload)
                else:
                    then = self._event(name, device, part, payload)
            except CollabslamError as error:
                self._refuse(device, f"{name}: ", error)
                return
        for do in then:
            do()

    def _device(self, name: str) -> _Device | None:
        """What is known of a device; None of one that may not speak."""
        if name not in self._devices:
            strangers = self._devices.keys() - self._awaited
            full = self._known is None and len(strangers) >= STRANGERS and name not in self._awaited
            if full or (self._known is not None and name not in self._known):
                return None
            self._devices[name] = _Device(Pairing(unposed=self._unposed))
        return self._devices[name]

    def _drop(self, device: _Device | None, reason: str) -> None:
        self.dropped[reason] += 1
        if device is not None:
            device.dropped[reason] += 1

    def _refuse(self, device: _Device | None, whose: str, error: CollabslamError) -> None:
        self._drop(device, MALFORMED)
        self.faults.append(f"{whose}{error}"[:LONGEST])

    def _event(self, name: str, device: _Device, part: str, payload: bytes) -> list[Callable[[], None]]:
        """What is to be done with a message, once others may come."""
        if part == names.BEAT:
            return []
        if part == names.EXCHANGE:
            session, exchange = messages.exchange_from(payload)
            session = names.own_session(name, session)
            if session != device.session:
                device.session, device.clock = session, ClockEstimator()
            device.clock.add(exchange)
            return [partial(self._give, ClockReading(session, exchange))]
        if part == names.CAMERA_INFO:
            device.camera = messages.told_camera(payload, name)
            self._told.set()
            return []
        if part == names.OWN:
            stamp, *own = messages.pose_from(payload, f"the device {name}")
            device.pairing.own(stamp, OwnPose(*own))
            return []
        if part == names.RATE:
            sample = messages.decoded(messages.IMU, payload)
            session = names.own_session(name, str(sample.header.frame_id))
            device.pairing.rates.add(session, messages.stamp_of(sample), messages.rate_of(sample))
            return []
        then: list[Callable[[], None]] = []
        if part == names.IMAGE:
            message = messages.decoded(messages.COMPRESSED, payload)
            stamp = messages.stamp_of(message)
            session = names.own_session(name, str(message.header.frame_id))
            device.images_received += 1
            if (taken := device.clock.robot_time(stamp)) is not None:
                device.arrivals.append(Arrival(stamp, taken[0], self._now()))
                if self.sensing is not None:
                    then.append(partial(self.sensing.image, name, stamp, taken[0]))
            view = device.pairing.image(session, stamp, message.data.tobytes())
        else:
            view = device.pairing.pose(*messages.pose_from(payload, f"the device {name}"))
        view = self._of_calibration(name, device, view)
        return then if view is None else [*then, partial(self._give, view)]

    def _sensed(self, name: str, device: _Device, part: str, payload: bytes) -> list[Callable[[], None]]:
        """The same of a sensor's message; its frame is the device's session, of a scan with the scanner."""
        if self.sensing is None:
            self._drop(device, UNASKED)
            return []
        message = messages.decoded(SENSORS[part], payload)
        session, scanner = str(message.header.frame_id), ""
        if part == names.SCAN:
            session, _, scanner = session.rpartition("/")
            if len(message.ranges) > MOST_BEAMS:
                raise DataError(f"A scan has {len(message.ranges)} beams; send at most {MOST_BEAMS}.")
        taken = device.clock.robot_time(messages.stamp_of(message))
        if taken is None or names.own_session(name, session) != device.session:
            self._drop(device, NO_CLOCK)
            return []
        if part == names.SCAN:
            scan = replace(scan_from(message, scanner), t=taken[0])
            return [partial(self.sensing.scan, scan)]
        where: Wearer = "worn" if part == names.ATTITUDE else "robot"
        reading = replace(reading_from(message, where), t=taken[0])
        if where == "worn":
            return [partial(self.sensing.worn, name, reading)]
        return [partial(self.sensing.reading, reading)]

    def _posed(self, image: tuple[str, float], t_cf: Array, covariance: Array, bias: Array | None) -> None:
        """The sensors told T_CF of an image."""
        name, stamp = image
        told = messages.pose_from(messages.pose(stamp, "", t_cf, covariance), name)  # as a record has it
        with self._lock:
            device = self._devices[name]
            view = self._of_calibration(name, device, device.pairing.pose(*told, bias))
        if view is not None:
            self._give(view)

    def _give(self, event: Event) -> None:
        if self.pictures is not None and isinstance(event, LiveView):
            self.pictures.take(sender_of(event.session), event)
        else:
            self.give(event)

    def drop(self, name: str, reason: str) -> None:
        """Count a view of a device that is dropped before the filter."""
        with self._lock:
            self._drop(self._devices.get(name), reason)

    def give(self, event: Event) -> None:
        """Push an event; what the filter says to it is kept among the `faults`."""
        try:
            self._push(event)
        except CollabslamError as error:  # the filter has ended: its own thread says so
            with self._lock:
                self.faults.append(str(error)[:LONGEST])

    def _of_calibration(self, name: str, device: _Device, view: LiveView | None) -> LiveView | None:
        """The view, unless its device's calibration is another than the filter's."""
        ours, theirs = self._cameras.get(name, self._cameras.get("")), device.camera
        if view is None or ours is None or theirs is None or _same(theirs, ours):
            return view
        self._drop(device, CALIBRATION)
        return None


def _same(a: Camera, b: Camera) -> bool:
    """Whether two calibrations are one as messages state them."""
    return messages.camera_info(0.0, "", a) == messages.camera_info(0.0, "", b)


def _allowed(device: _Device, part: str, now: float) -> bool:
    """Whether one more message of a kind is within its rate."""
    left, then = device.allowed.get(part, (BURST, now))
    left = min(BURST, left + (now - then) * RATES[part])
    device.allowed[part] = (max(0.0, left - 1.0), now)
    return left >= 1.0


def _report(device: _Device, now: float) -> dict[str, float]:
    counts = device.dropped + Counter({UNPAIRED: device.pairing.unpaired})
    dropped = {f"{DROPPED}{reason}": float(count) for reason, count in counts.items() if count}
    if not device.arrivals:
        return {"images": device.images_received, **dropped}
    ages = [1e3 * arrival.age for arrival in device.arrivals]
    return {
        "images": device.images_received,
        "age_ms": ages[-1],
        "age_median_ms": statistics.median(ages[-10:]),
        "last_image_s": now - device.arrivals[-1].came,
        "clock_drift_ppm": 1e6 * device.clock.drift,
        **dropped,
    }

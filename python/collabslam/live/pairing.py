"""Images of Cf and their measured poses come apart, in any order; views are made of those of one stamp."""

from __future__ import annotations

from collections import OrderedDict
from typing import TypeVar

from collabslam.live.device_rates import DeviceRates
from collabslam.live.views import LiveView, OwnPose
from collabslam.types import Array, Image

WAITING = 8
"""Images, and poses, that wait for each other."""

Value = TypeVar("Value")


class Pairing:
    """The images and the poses of one sender.

    Parameters
    ----------
    unposed : bool
        Whether an image whose pose is not there yet is a view at once, without a pose.

    Attributes
    ----------
    unpaired : int
        Images that gave way before their pose came.
    rates : DeviceRates
        Of the sender's gyroscope; a view has what it tells of its image by then.
    """

    def __init__(self, *, unposed: bool = False) -> None:
        self.unpaired = 0
        self.rates = DeviceRates()
        self._unposed = unposed
        self._images: OrderedDict[float, tuple[str, Image | bytes]] = OrderedDict()
        self._poses: OrderedDict[float, tuple[Array, Array, Array | None]] = OrderedDict()
        self._own: OrderedDict[float, OwnPose] = OrderedDict()

    def image(self, session: str, stamp: float, image: Image | bytes) -> LiveView | None:
        """An image; the view, if its pose is there."""
        if self._unposed and stamp not in self._poses:
            rate = self.rates.at(session, stamp)
            return LiveView(session, stamp, image, own=self._own.pop(stamp, None), rate=rate)
        self.unpaired += _keep(self._images, stamp, (session, image))
        return self._view(stamp)

    def pose(
        self, stamp: float, t_cf: Array, covariance: Array, bias: Array | None = None
    ) -> LiveView | None:
        """A pose, as in `collabslam.WornView`; the view, if its image is there."""
        _keep(self._poses, stamp, (t_cf, covariance, bias))
        return self._view(stamp)

    def own(self, stamp: float, own: OwnPose) -> None:
        """Where the camera is in its own world; it is sent before its image, and none waits for it."""
        _keep(self._own, stamp, own)

    def _view(self, stamp: float) -> LiveView | None:
        if stamp not in self._images or stamp not in self._poses:
            return None
        session, image = self._images.pop(stamp)
        own, rate = self._own.pop(stamp, None), self.rates.at(session, stamp)
        return LiveView(session, stamp, image, *self._poses.pop(stamp), own=own, rate=rate)


def _keep(waiting: OrderedDict[float, Value], stamp: float, value: Value) -> bool:
    """Lets one more wait; True if the oldest had to give way."""
    waiting[stamp] = value
    if len(waiting) <= WAITING:
        return False
    waiting.popitem(last=False)
    return True

"""What callers hand in, as events: whatever is not one is refused at the call, and ends nothing."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, SupportsFloat, cast

import numpy as np

from collabslam._core import LAST_TIME
from collabslam.errors import InputError
from collabslam.live.clock import Exchange
from collabslam.live.core import ClockReading, Event, GyroSample, OdometrySample, RobotFrame
from collabslam.live.names import check_session
from collabslam.live.views import LiveView, OwnPose
from collabslam.types import Array, Image

MOST_BYTES = 1 << 24
"""Bytes of an encoded view."""


def robot_frame(t: Any, image: Any) -> RobotFrame:
    """A frame of Cs; InputError if it can be none, whatever the engine says of it."""
    return RobotFrame(_seconds(t), _pixels(image))


def live_view(
    session: Any, t: Any, image: Any, t_cf: Any, covariance: Any, bias: Any = None, *, rate: Any = None
) -> LiveView:
    """A view of Cf whose arrays have their shapes; raises InputError otherwise."""
    check_session(session)
    first, second = _array(t_cf, (4, 4), "T_CF"), _array(covariance, (6, 6), "covariance")
    if (first is None) != (second is None):
        raise InputError("A view has T_CF and its covariance, or neither; give both.")
    if isinstance(image, bytes) and len(image) > MOST_BYTES:
        raise InputError(
            f"The view has {len(image) >> 20} MB; give a JPEG or PNG of at most {MOST_BYTES >> 20}."
        )
    encoded = image if isinstance(image, bytes) else _pixels(image)
    third, turning = _array(bias, (6, 6), "bias"), _array(rate, (3,), "rate of Cf")
    return LiveView(session, _seconds(t), encoded, first, second, third, rate=turning)


def odometry_sample(t: Any, twist: Any, covariance: Any) -> OdometrySample:
    """Odometry whose arrays have their shapes; raises InputError otherwise."""
    first, second = _array(twist, (6,), "twist"), _array(covariance, (6, 6), "covariance")
    if first is None or second is None:
        raise InputError("Odometry is a twist (6,) with a covariance (6, 6); give both.")
    return OdometrySample(_seconds(t), first, second)


def gyro_sample(t: Any, rate: Any, acceleration: Any = None) -> GyroSample:
    """A rate of the gyroscope, and maybe an acceleration; raises InputError if it is none."""
    found = _array(rate, (3,), "rate")
    if found is None:
        raise InputError("A gyroscope's sample is a rate (3,), rad/s; give one.")
    return GyroSample(_seconds(t), found, _array(acceleration, (3,), "acceleration"))


def clock_reading(session: Any, exchange: Any) -> ClockReading:
    """What a sender's clock said; InputError for anything else than an `Exchange` of finite times."""
    check_session(session)
    if not isinstance(exchange, Exchange):
        raise InputError("What a clock says is a collabslam.live.clock.Exchange; give one.")
    return ClockReading(session, Exchange(*map(_seconds, vars(exchange).values())))


def checked(event: Any) -> Event:
    """The event, if it is one; raises InputError otherwise."""
    if isinstance(event, RobotFrame):
        return robot_frame(event.t, event.image)
    if isinstance(event, ClockReading):
        return clock_reading(event.session, event.exchange)
    if isinstance(event, OdometrySample):
        return odometry_sample(event.t, event.twist, event.covariance)
    if isinstance(event, GyroSample):
        return gyro_sample(event.t, event.rate, event.acceleration)
    if isinstance(event, LiveView):
        told = (event.session, event.stamp, event.image, event.t_cf, event.covariance, event.bias)
        own = None if event.own is None else _own_pose(event.own)
        pixels = None if event.pixels is None else _pixels(event.pixels)
        return replace(live_view(*told, rate=event.rate), own=own, pixels=pixels)
    raise InputError(f"A {type(event).__name__} is not an event; push one of collabslam.live.core.Event.")


def _own_pose(own: Any) -> OwnPose:
    if not isinstance(own, OwnPose):
        raise InputError("Where a camera tracks itself is a collabslam.live.views.OwnPose; give one.")
    pose, covariance = _array(own.t_xf, (4, 4), "own pose"), _array(own.covariance, (6, 6), "own covariance")
    if pose is None or covariance is None:
        raise InputError("Where a camera tracks itself has a pose and a covariance; give both.")
    return OwnPose(pose, covariance)


def _seconds(t: Any) -> float:
    try:
        found = float(cast(SupportsFloat, t))
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if isinstance(t, str | bytes) or not abs(found) < LAST_TIME:
        raise InputError(f"The time {str(t)[:40]!r} is none; give seconds as a finite number.")
    return found


def _pixels(image: Any) -> Image:
    """The array itself: what must be of it is asked where its camera is known."""
    if not isinstance(image, np.ndarray):
        raise InputError(f"An image is an array (H, W) of uint8, not a {type(image).__name__}; give one.")
    return image


def _array(value: Any, shape: tuple[int, ...], name: str) -> Array | None:
    """A copy, finite and of that shape; None of None."""
    if value is None:
        return None
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"The {name} is not an array of numbers; give one of the shape {shape}.") from None
    if array.shape != shape:
        raise InputError(f"The {name} has the shape {array.shape}; give {shape}.")
    return array

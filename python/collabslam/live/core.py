"""The robot's side without threads and network: what comes goes in, in order, and poses come out.

The same events in the same order give the same poses to the last bit; no clock is asked.  That is what makes
a live run the same as its record.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from collabslam.errors import DataError, InputError
from collabslam.geometry import pose_inverse
from collabslam.live.clock import Exchange
from collabslam.live.decoding import view_image
from collabslam.live.printed import PrintedPoses
from collabslam.live.refusals import Refusals
from collabslam.live.senders import Senders
from collabslam.live.views import BROKEN, REFUSED, UNPOSED, LiveView
from collabslam.results import StepResult
from collabslam.slam.engine import Slam
from collabslam.targets.kinds import Board, Tag
from collabslam.types import Array, Image, WornView


@dataclass(frozen=True, eq=False)
class RobotFrame:
    """A frame of the robot's camera: ``t`` seconds by its own clock, ``image`` (H, W) uint8."""

    t: float
    image: Image


@dataclass(frozen=True, eq=False)
class ClockReading:
    """What a sender's clock said."""

    session: str
    exchange: Exchange


@dataclass(frozen=True, eq=False)
class OdometrySample:
    """Odometry of the robot at ``t`` seconds by its own clock, as `collabslam.Slam.add_odometry` takes it."""

    t: float
    twist: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class GyroSample:
    """A rate of Cs's gyroscope at ``t`` seconds by its own clock, as `collabslam.Slam.add_gyro` takes it, and
    maybe what the accelerometer beside it said, as `collabslam.Slam.add_acceleration` does."""

    t: float
    rate: Array
    acceleration: Array | None = None


COLLAB, MONO = "collab", "mono"
"""Of a link: views come, or none do."""

Event = RobotFrame | LiveView | ClockReading | OdometrySample | GyroSample
"""What can reach the filter."""


@dataclass(frozen=True, eq=False)
class LivePose:
    """A frame's answer.

    Attributes
    ----------
    step : StepResult
        Pose, covariance, status and diagnostics.
    links : mapping
        Of each worn camera by name: ``collab`` if a view of it reached the filter within the last second,
        else ``mono``.
    sessions : tuple of str
        Whose views were used in this frame.
    image : (H, W) uint8
        Of Cs.
    views : tuple of WornView
        What was used of the worn cameras, in the same order.
    """

    step: StepResult
    links: Mapping[str, str]
    sessions: tuple[str, ...]
    image: Image
    views: tuple[WornView, ...]

    @property
    def link(self) -> str:
        """``collab`` if that of one of them is, else ``mono``."""
        return COLLAB if COLLAB in self.links.values() else MONO


class LiveCore:
    """An engine that is fed by events.

    A view goes to the engine as it comes, and waits there; a frame waits for nothing, and uses the newest
    view of each person that is there, for the moment at which it was taken (METHOD section 21).

    Parameters
    ----------
    slam : Slam
    same_clock : bool
        Whether views are stamped in the robot's time.
    targets : sequence of Tag and Board
        Printed targets that tell T_CF of views that come without it.
    """

    def __init__(self, slam: Slam, *, same_clock: bool = False, targets: Sequence[Tag | Board] = ()) -> None:
        self.slam = slam
        self.senders = Senders(slam.worn_cameras, same_clock=same_clock)
        self.refused = Refusals()
        """Frames of Cs that could not be used."""
        self.refused_odometry = Refusals()
        """Samples of odometry that could not be used."""
        self.refused_gyro = Refusals()
        """Rates of the gyroscope, or accelerations, that could not be used."""
        self._printed = PrintedPoses(slam.camera, slam.worn_cameras, targets, slam.worn_late)
        self._last = slam.filter.time

    @property
    def dropped(self) -> Counter[str]:
        """Views that were not used, by reason: `collabslam.live.views.REASONS` and `Slam.worn_dropped`."""
        return self.senders.dropped + Counter(self.slam.worn_dropped)

    def handle(self, event: Event) -> LivePose | None:
        """Take one event; the answer to a frame, None for anything else and for a frame that is refused.

        Raises
        ------
        FilterError
            If the filter meets a numerical state from which it cannot go on.
        """
        if isinstance(event, RobotFrame):
            return self._step(event)
        if isinstance(event, ClockReading):
            self.senders.exchange(event.session, event.exchange)
        elif isinstance(event, OdometrySample):
            try:
                self.slam.add_odometry(event.t, event.twist, event.covariance)
            except InputError as error:
                self.refused_odometry.add(error)
        elif isinstance(event, GyroSample):
            try:
                self.slam.add_gyro(event.t, event.rate)
                if event.acceleration is not None:
                    self.slam.add_acceleration(event.t, event.acceleration)
            except InputError as error:
                self.refused_gyro.add(error)
        elif self.slam.worn_cameras:
            self._hand_in(event)
        return None

    def _step(self, frame: RobotFrame) -> LivePose | None:
        try:
            step = self.slam.step(frame.t, frame.image)
        except InputError as error:
            self.refused.add(error)
            return None
        self._printed.frame(frame.t, frame.image)
        self._last = frame.t
        views, sessions = self.slam.views_used, self.senders.sessions
        self.senders.used(frame.t, [view.who for view in views])
        links = {name: COLLAB if heard else MONO for name, heard in self.senders.heard(frame.t).items()}
        return LivePose(step, links, tuple(sessions.get(view.who, "") for view in views), frame.image, views)

    def _hand_in(self, view: LiveView) -> None:
        """Gives the engine a view that comes, if its sender's are used and its pose is known."""
        timed = self.senders.timed(view, self._last)
        if timed is None:
            return
        name, t, t_sd = timed
        try:
            image = view_image(
                view.image if view.pixels is None else view.pixels, self.slam.worn_cameras[name]
            )
        except (DataError, InputError):
            self.senders.drop(view.session, BROKEN)
            return
        worn: WornView | None
        if view.t_cf is not None and view.covariance is not None:
            worn = WornView(image, view.t_cf, view.covariance, view.bias, t, name)
            worn = _with_clock_error(worn, t_sd, self.slam)
        else:
            worn = self._printed.pose(name, view, t, image)
        try:
            if worn is not None:
                self.slam.add_worn(replace(worn, rate=view.rate))
            else:
                self.senders.drop(view.session, UNPOSED)
        except InputError:
            self.senders.drop(view.session, REFUSED)


def _with_clock_error(worn: WornView, t_sd: float, slam: Slam) -> WornView:
    """T_CF as uncertain as the view's instant makes it: the robot moves on while the view stands."""
    if t_sd == 0.0:
        return worn
    core = slam.filter
    velocity = pose_inverse(core.pose)[:3, :3] @ core.velocity
    turn = core.angular_velocity
    back = worn.t_cf[:3, :3].T
    rate = np.concatenate([back @ (velocity + np.cross(turn, worn.t_cf[:3, 3])), back @ turn])
    return replace(worn, covariance=worn.covariance + t_sd**2 * np.outer(rate, rate))

"""The robot's side without threads and network: what comes goes in, in order, and poses come out.

The same events in the same order give the same poses to the last bit; no clock is asked.  That is what makes
a live run the same as its record.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from collabslam.errors import DataError, InputError
from collabslam.geometry import pose_inverse
from collabslam.live.clock import Exchange
from collabslam.live.decoding import view_image
from collabslam.live.persons import WaitingPersons
from collabslam.live.printed import PrintedPoses
from collabslam.live.views import BROKEN, LATEST, REFUSED, UNPOSED, LiveView, TimedView
from collabslam.results import StepResult
from collabslam.slam.engine import Slam
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


COLLAB, MONO = "collab", "mono"
"""Of a link: views come, or none do."""

Event = RobotFrame | LiveView | ClockReading | OdometrySample
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

    @property
    def session(self) -> str | None:
        """The first of the sessions, if any."""
        return next(iter(self.sessions), None)

    @property
    def worn(self) -> WornView | None:
        """The first of the views, if any."""
        return next(iter(self.views), None)


class LiveCore:
    """An engine that is fed by events.

    A frame waits for nothing: of each person it takes the newest view that is there, which the engine uses
    for the moment at which it was taken (METHOD section 21).

    Parameters
    ----------
    slam : Slam
    same_clock : bool
        Whether views are stamped in the robot's time.
    printed : PrintedPoses, optional
        Tells T_CF of views that come without it.
    """

    def __init__(
        self,
        slam: Slam,
        *,
        same_clock: bool = False,
        printed: PrintedPoses | None = None,
    ) -> None:
        self.slam = slam
        self.views = WaitingPersons(slam.worn_cameras, same_clock=same_clock)
        self.refused: Counter[str] = Counter()
        """Frames of Cs that could not be used, by the error's text."""
        self.refused_odometry: Counter[str] = Counter()
        """Samples of odometry that could not be used, by the error's text."""
        self._worn_cameras = slam.worn_cameras
        self._printed = printed
        self._last = self.slam.filter.time
        self._collab = dict.fromkeys(self._worn_cameras, -float("inf"))

    def handle(self, event: Event) -> LivePose | None:
        """Take one event; the answer to a frame, None for anything else and for a frame that is refused.

        Raises
        ------
        FilterError
            If the filter meets a numerical state from which it cannot go on.
        """
        if isinstance(event, RobotFrame):
            if self._printed is not None:
                self._printed.frame(event.t, event.image)
            return self._step(event)
        if isinstance(event, ClockReading):
            self.views.exchange(event.session, event.exchange)
        elif isinstance(event, OdometrySample):
            try:
                self.slam.add_odometry(event.t, event.twist, event.covariance)
            except InputError as error:
                self.refused_odometry[str(error)] += 1
        elif self._worn_cameras:
            self.views.add(event, self._last)
        return None

    def _step(self, frame: RobotFrame) -> LivePose | None:
        timed = self.views.take(frame.t)
        found = {name: self._worn_view(name, view) for name, view in timed.items()}
        worn = {name: view for name, view in found.items() if view is not None}
        while True:
            try:
                step = self.slam.step(frame.t, frame.image, tuple(worn.values()))
                break
            except InputError as error:
                if not worn:
                    self.refused[str(error)] += 1
                    return None
                for name in [name for name, view in worn.items() if self._is_impossible(view)] or list(worn):
                    self.views.refuse(name, REFUSED)
                    del worn[name]
        self._last = frame.t
        self._collab.update(dict.fromkeys(worn, frame.t))
        links = {n: COLLAB if frame.t - last <= LATEST else MONO for n, last in self._collab.items()}
        sessions = tuple(timed[name].view.session for name in worn)
        return LivePose(step, links, sessions, frame.image, tuple(worn.values()))

    def _is_impossible(self, view: WornView) -> bool:
        """Whether the engine refuses this view, whatever comes with it."""
        try:
            self.slam.check_worn(view)
        except InputError:
            return True
        return False

    def _worn_view(self, name: str, timed: TimedView) -> WornView | None:
        """A person's view for the filter, or None if it is none."""
        view = timed.view
        try:
            image = view_image(view.image, self._worn_cameras[name])
        except (DataError, InputError):
            self.views.refuse(name, BROKEN)
            return None
        if view.t_cf is not None and view.covariance is not None:
            worn = WornView(image, view.t_cf, view.covariance, view.bias, timed.t, name)
            return self._with_clock_error(worn, timed.t_sd)
        found = None if self._printed is None else self._printed.pose(name, view, timed.t, image)
        if found is None:
            self.views.refuse(name, UNPOSED)
        return found

    def _with_clock_error(self, worn: WornView, t_sd: float) -> WornView:
        """T_CF as uncertain as the view's instant makes it: the robot moves on while the view stands."""
        if t_sd == 0.0:
            return worn
        rate = _drift_of_view(worn.t_cf, self.slam)
        return replace(worn, covariance=worn.covariance + t_sd**2 * np.outer(rate, rate))


def _drift_of_view(t_cf: Array, slam: Slam) -> Array:
    """(6,) change of T_CF per second for a Cf that stands still in W, tangent on the right, m/s and rad/s."""
    core = slam.filter
    velocity = pose_inverse(core.pose)[:3, :3] @ core.velocity
    turn = core.angular_velocity
    back = t_cf[:3, :3].T
    return -np.concatenate([back @ (velocity + np.cross(turn, t_cf[:3, 3])), back @ turn])

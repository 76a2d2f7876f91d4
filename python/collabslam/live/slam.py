"""`LiveSlam`: frames and views from any thread, poses from a thread of its own."""

from __future__ import annotations

import atexit
import itertools
import threading
import weakref
from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from types import TracebackType
from typing import Any, TypeVar

from numpy.typing import ArrayLike

from collabslam.errors import CollabslamError, InputError
from collabslam.live.arguments import (
    checked,
    clock_reading,
    gyro_sample,
    live_view,
    odometry_sample,
    robot_frame,
)
from collabslam.live.clock import Exchange
from collabslam.live.core import (
    ClockReading,
    Event,
    GyroSample,
    LiveCore,
    LivePose,
    OdometrySample,
    RobotFrame,
)
from collabslam.live.views import LiveView
from collabslam.slam.engine import Slam
from collabslam.slam.worn.late_views import CROWDED
from collabslam.targets.kinds import Board, Tag
from collabslam.types import Image

BOUNDS: dict[type, int] = {
    RobotFrame: 4,
    LiveView: 16,
    ClockReading: 32,
    OdometrySample: 1000,
    GyroSample: 4000,
}
"""Events of each kind that wait for the filter at most, views of each person; the oldest gives way."""
T = TypeVar("T")
Queue = tuple[type, str | None]
LAST_FRAME = 10.0
"""Seconds that a program that ends waits for the frame that is being worked on."""
_OPEN: weakref.WeakSet[LiveSlam] = weakref.WeakSet()


class LiveSlam:
    """Collaborative monocular SLAM while it happens; a context manager.

    ``push_robot``, ``push_worn`` and ``push_clock`` take what comes and return at once, whatever thread calls
    them and whatever the filter does; ``on_pose`` is called from a thread of the filter's own.  What waits is
    bounded by counts (`BOUNDS`): a filter that is slower than the camera loses frames, never falls behind.

    Parameters
    ----------
    slam : Slam
        The engine, new or resumed; only ``on_pose`` may use it before `close`.
    on_pose : callable, optional
        Is given the `LivePose` of each frame.  It may use ``slam``.  What it raises ends nothing and is
        kept as ``callback_error``; but a `CollabslamError` ends the filter.
    on_event : callable, optional
        Is given each event before the filter takes it, in that order: what a record needs.  What it raises
        is as of ``on_pose``.
    same_clock : bool
        Whether both cameras are stamped by one clock; otherwise `push_clock` must say what the worn one's is.
    targets : sequence of Tag and Board
        Printed targets that stand still: where both cameras see one, it tells T_CF of views that come without
        it.  (`Slam.add_tag` says that one is a measure of length, too.)

    Attributes
    ----------
    slam : Slam
    callback_error : Exception or None
    """

    def __init__(
        self,
        slam: Slam,
        *,
        on_pose: Callable[[LivePose], None] | None = None,
        on_event: Callable[[Event], None] | None = None,
        same_clock: bool = False,
        targets: Sequence[Tag | Board] = (),
    ) -> None:
        self.slam = slam
        self.callback_error: Exception | None = None
        self._core = LiveCore(slam, same_clock=same_clock, targets=targets)
        self._on_pose, self._on_event = on_pose, on_event
        self._change = threading.Condition()
        self._events: deque[Event] = deque()
        self._questions: deque[Callable[[], None]] = deque()
        self._waiting: Counter[Queue] = Counter()
        self._lost: Counter[type] = Counter()
        self._closing, self._flush, self._exits = False, True, False
        self._error: BaseException | None = None
        self._worker = threading.Thread(target=self._work, name="collabslam", daemon=True)
        self._worker.start()
        _OPEN.add(self)

    def push_robot(self, t: float, image: Image) -> None:
        """A frame of Cs: ``t`` seconds by the robot's clock, ``image`` (H, W) uint8, not to be changed later.

        Raises
        ------
        InputError
            If there is no time or no array, or it is closed.
        CollabslamError
            Whatever ended the filter.
        """
        self._push(robot_frame(t, image))

    def push_worn(
        self,
        t: float,
        image: Image | bytes,
        t_cf: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        *,
        bias: ArrayLike | None = None,
        rate: ArrayLike | None = None,
        session: str = "worn",
    ) -> None:
        """A view of Cf.

        Parameters
        ----------
        t : float
            Seconds by the sender's clock.
        image : (H, W) uint8, or bytes
            Grey, or a JPEG or PNG of it.
        t_cf, covariance, bias, rate
            As in `collabslam.WornView`; without ``t_cf`` the targets must tell it.
        session : str
            Who sends, as ``anna/17``: another one each time that the sender starts.  Where the engine's worn
            cameras have names, what stands before the last ``/`` says whose the view is.  Letters, digits, _
            and -, 32 before it and 64 behind it.

        Raises
        ------
        InputError
            For arrays of another shape, a session that cannot be called so, or if it is closed.
        CollabslamError
            Whatever ended the filter.
        """
        self._push(live_view(session, t, image, t_cf, covariance, bias, rate=rate))

    def push_odometry(self, t: float, twist: ArrayLike, covariance: ArrayLike) -> None:
        """Odometry of the robot, by its clock, as `collabslam.Slam.add_odometry` takes it.

        What the engine refuses is counted in `refused`.

        Raises
        ------
        InputError
            For arrays of another shape, or if it is closed.
        CollabslamError
            Whatever ended the filter.
        """
        self._push(odometry_sample(t, twist, covariance))

    def push_gyro(self, t: float, rate: ArrayLike, acceleration: ArrayLike | None = None) -> None:
        """A rate of Cs's gyroscope, by its clock, as `collabslam.Slam.add_gyro` takes it, and what an
        accelerometer beside it says, as `collabslam.Slam.add_acceleration` does.

        The engine is made with the sensor's `Imu`; what it refuses is counted in `refused`.

        Raises
        ------
        InputError
            For an array of another shape, or if it is closed.
        CollabslamError
            Whatever ended the filter.
        """
        self._push(gyro_sample(t, rate, acceleration))

    def push_clock(self, session: str, exchange: Exchange) -> None:
        """What a sender's clock said; raises as `push_robot` does."""
        self._push(clock_reading(session, exchange))

    def push(self, event: Event) -> None:
        """Any of these; raises as they do."""
        self._push(checked(event))

    def ask(self, question: Callable[[Slam], T]) -> Future[T]:
        """Has the filter's thread call ``question`` with the engine before the next event.

        Returns what becomes of it: what it returns, or raises.

        Raises
        ------
        InputError
            If it is closed.
        CollabslamError
            Whatever ended the filter.
        """
        answer: Future[T] = Future()

        def work() -> None:
            try:
                answer.set_result(question(self.slam))
            except Exception as error:
                answer.set_exception(error)

        with self._change:
            self._check_open()
            self._questions.append(work)
            self._change.notify()
        return answer

    @property
    def dropped(self) -> dict[str, int]:
        """Views that were dropped, by reason (`collabslam.live.views.REASONS`, `Slam.worn_dropped`), and
        ``frames`` of Cs."""
        counts = self._core.dropped
        with self._change:
            counts[CROWDED] += self._lost[LiveView]
            counts["frames"] = self._lost[RobotFrame] + sum(self._core.refused.values())
        return {reason: count for reason, count in counts.items() if count}

    @property
    def refused(self) -> dict[str, int]:
        """Why frames of Cs, odometry or rates were refused, in words, and how often; see `refusals`."""
        return {**self._core.refused, **self._core.refused_odometry, **self._core.refused_gyro}

    @property
    def sessions(self) -> dict[str, str]:
        """The sessions whose views are used, by the name of the worn camera."""
        return self._core.senders.sessions

    @property
    def views(self) -> dict[str, dict[str, int]]:
        """What became of the views of each sender: ``used``, and ``dropped`` with the reason; only for
        ``on_pose``, and once it is closed."""
        return {name: dict(counts) for name, counts in self._core.senders.counts.items()}

    def close(self, *, flush: bool = True) -> None:
        """Ends the thread, after all that waits was done, or at once without ``flush``.

        In a callback, which the thread itself calls, it ends after that.  A program may end without it; what
        is pushed while it does is dropped.

        Raises
        ------
        CollabslamError
            Whatever ended the filter.
        """
        self._end(flush=flush)
        if threading.current_thread() is self._worker:
            return
        self._worker.join()
        _OPEN.discard(self)
        if self._error is not None:
            raise self._error

    def __enter__(self) -> LiveSlam:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(flush=error is None)

    def _end(self, *, flush: bool) -> None:
        with self._change:
            self._closing, self._flush = True, flush
            self._change.notify_all()

    def _push(self, event: Event) -> None:
        kind, queue = type(event), self._queue(event)
        with self._change:
            if self._exits:
                return  # an error of a daemon thread would be printed while that can abort the process
            self._check_open()
            if self._waiting[queue] >= BOUNDS[kind]:
                self._remove(next(e for e in self._events if self._queue(e) == queue))
                self._waiting[queue] += 1
                if kind is RobotFrame:
                    self._let_frames_pass()
            else:
                self._waiting[queue] += 1
            self._events.append(event)
            self._change.notify()

    def _check_open(self) -> None:
        if self._error is not None:
            raise self._error
        if self._closing:
            raise InputError("This LiveSlam is closed; make another one.")

    def _remove(self, event: Event) -> None:
        """Lose one that waits."""
        self._events.remove(event)
        self._waiting[self._queue(event)] -= 1
        self._lost[type(event)] += 1

    def _let_frames_pass(self) -> None:
        """A frame has been lost: views before the next one give way, or frames would wait for views, be lost
        in their turn, and none would ever be done."""
        before = itertools.takewhile(lambda e: not isinstance(e, RobotFrame), self._events)
        for view in [event for event in before if isinstance(event, LiveView)]:
            self._remove(view)

    def _next(self) -> Event | Callable[[], None] | None:
        """A question, or the next event; None when there is none left and none will come."""
        with self._change:
            while not self._events and not self._questions and not self._closing:
                self._change.wait()
            if self._questions:
                return self._questions.popleft()
            if not self._events or (self._closing and not self._flush):
                return None
            event = self._events.popleft()
            self._waiting[self._queue(event)] -= 1
            return event

    def _queue(self, event: Event) -> Queue:
        """Among what an event waits."""
        whose = self._core.senders.person_of(event.session) if isinstance(event, LiveView) else None
        return type(event), whose

    def _work(self) -> None:
        try:
            while (event := self._next()) is not None:
                if callable(event):
                    event()
                    continue
                self._call(self._on_event, event)
                pose = self._core.handle(event)
                if pose is not None:
                    self._call(self._on_pose, pose)
        except BaseException as error:
            with self._change:
                self._error = error

    def _call(self, back: Callable[[Any], None] | None, value: Any) -> None:
        try:
            if back is not None:
                back(value)
        except CollabslamError:
            raise
        except Exception as error:
            self.callback_error = error


@atexit.register
def _end_all() -> None:
    """The interpreter ends: no thread may be in the filter when what it uses is taken away."""
    for live in list(_OPEN):
        live._exits = True
        live._end(flush=False)
    for live in list(_OPEN):
        live._worker.join(LAST_FRAME)

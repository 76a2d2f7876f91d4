"""Views of the worn camera on their way to the filter: which are used, and why the others are not."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass

from collabslam.live.clock import ClockEstimator, Exchange
from collabslam.types import Array, Image

LATE = "late"  # taken more than a second ago
EARLY = "early"  # its stamp is ahead of the robot's time
REPEATED = "repeated"  # a stamp that came before
SURPLUS = "surplus"  # more views than frames, or than may wait
NO_CLOCK = "no clock"  # nothing is known of the sender's clock
OTHER = "other session"  # another worn camera is at work, or its sender has been started anew
NOBODY = "no person"  # of several persons none is called as its sender is
BROKEN = "broken"  # no image, or of another size
REFUSED = "refused"  # T_CF or its covariance is impossible
UNPOSED = "no target"  # it came without T_CF, and both cameras see no printed target
REASONS = (LATE, EARLY, REPEATED, SURPLUS, NO_CLOCK, OTHER, NOBODY, BROKEN, REFUSED, UNPOSED)
"""Why a view was dropped; the keys of the counts."""

TOLERANCE = 0.001
"""Seconds by which a view may be ahead of the frame that it comes with: clocks are not known better."""
LATEST = 1.0
"""Seconds after which a view is of no use, and a session without views no longer at work."""
WAITING, REMEMBERED, SESSIONS = 16, 64, 8
"""Views that wait, stamps that are remembered for each session, sessions that are."""


@dataclass(frozen=True, eq=False)
class OwnPose:
    """Where a camera that tracks itself is in a world of its own, which begins anywhere and drifts.

    Attributes
    ----------
    t_xf : (4, 4) array
        Maps points of the camera into that world; metres.
    covariance : (6, 6) array
        Of what errs in each image anew, over (translation, rotation), tangent on the right; without drift.
    """

    t_xf: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class LiveView:
    """A view of the worn camera as its sender took it.

    Attributes
    ----------
    session : str
        Who sent it; another one each time that the sender starts.  What stands before the last ``/`` is the
        sender's name.
    stamp : float
        Seconds by the sender's clock.
    image : (H, W) uint8, or bytes
        Grey, or a JPEG or PNG of it; an encoded one may be smaller than its calibration.
    t_cf, covariance, bias
        As in `collabslam.WornView`; no ``t_cf`` if printed targets are to tell it.
    own : OwnPose or None
        Of a camera that tracks itself: then the targets need not be in this image.
    """

    session: str
    stamp: float
    image: Image | bytes
    t_cf: Array | None = None
    covariance: Array | None = None
    bias: Array | None = None
    own: OwnPose | None = None


@dataclass(frozen=True, eq=False)
class TimedView:
    """A view in the robot's time: ``t`` seconds, with the standard deviation ``t_sd``."""

    view: LiveView
    t: float
    t_sd: float


class _Session:
    """What is known of one sender since it started."""

    def __init__(self) -> None:
        self.clock = ClockEstimator()
        self.stamps: deque[float] = deque(maxlen=REMEMBERED)


class WaitingViews:
    """Views that came and have not been used, of one sender at a time.

    A sender that starts anew takes the place of its earlier session at once; another one, when the session at
    work has sent nothing for `LATEST` seconds of the robot's frames.

    Parameters
    ----------
    same_clock : bool
        Whether stamps are the robot's own time, so that no clock is needed.
    """

    def __init__(self, *, same_clock: bool = False) -> None:
        self.dropped: Counter[str] = Counter()
        """By reason."""
        self.reordered = 0
        """Views that came after a later one."""
        self.session: str | None = None
        """The one at work."""
        self._same_clock = same_clock
        self._sessions: dict[str, _Session] = {}
        self._ended: deque[str] = deque(maxlen=REMEMBERED)
        self._waiting: list[TimedView] = []
        self._heard = -float("inf")

    def exchange(self, session: str, exchange: Exchange) -> None:
        """Learn of a sender's clock."""
        self._of(session).clock.add(exchange)

    def clock(self, session: str) -> ClockEstimator:
        """What is known of a sender's clock."""
        return self._of(session).clock

    def add(self, view: LiveView, now: float | None) -> bool:
        """Let a view wait, at the time ``now`` of the robot's last frame, if any; False if it is dropped."""
        session = self._of(view.session)
        if view.stamp in session.stamps:
            return self._drop(REPEATED)
        at = (view.stamp, 0.0) if self._same_clock else session.clock.robot_time(view.stamp)
        if at is None:
            return self._drop(NO_CLOCK)
        now = at[0] if now is None else now
        if not self._admit(view.session, now):
            return self._drop(OTHER)
        if at[0] < now - LATEST:
            return self._drop(LATE)
        if at[0] > now + LATEST:
            return self._drop(EARLY)
        self.reordered += any(stamp > view.stamp for stamp in session.stamps)
        session.stamps.append(view.stamp)
        self._heard = now
        self._waiting.append(TimedView(view, *at))
        self._waiting.sort(key=lambda v: v.t)
        if len(self._waiting) > WAITING:
            self._waiting.pop(0)
            return self._drop(SURPLUS)
        return True

    def take(self, t: float) -> TimedView | None:
        """The newest view that was taken before the frame at ``t`` or with it; earlier ones are dropped."""
        there = [v for v in self._waiting if v.t <= t + TOLERANCE]
        self._waiting = [v for v in self._waiting if v.t > t + TOLERANCE]
        chosen = there.pop() if there and there[-1].t >= t - LATEST else None
        for v in there:
            self._drop(LATE if v.t < t - LATEST else SURPLUS)
        return chosen

    def refuse(self, reason: str) -> None:
        """Count a view that was taken and could not be used."""
        self.dropped[reason] += 1

    def _admit(self, session: str, now: float) -> bool:
        """Whether views of this session are used."""
        if session == self.session:
            return True
        if session in self._ended:
            return False
        before = self.session
        anew = before is not None and sender_of(before) == sender_of(session)
        if before is not None and not anew and now - self._heard <= LATEST:
            return False
        if before is not None and anew:
            self._ended.append(before)
            self._sessions.pop(before, None)
        self.session = session
        return True

    def _of(self, session: str) -> _Session:
        """A session's own state; of too many, the oldest that is not at work is forgotten."""
        if session not in self._sessions:
            if len(self._sessions) >= SESSIONS:
                del self._sessions[next(s for s in self._sessions if s != self.session)]
            self._sessions[session] = _Session()
        return self._sessions[session]

    def _drop(self, reason: str) -> bool:
        self.dropped[reason] += 1
        return False


def sender_of(session: str) -> str:
    """What the sender of a session is called."""
    return session.rpartition("/")[0] or session

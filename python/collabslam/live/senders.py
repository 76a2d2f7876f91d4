"""Who sends views: whose worn camera it is, by which clock, and whose views are used of several senders.

A sender is called as its sessions say: what stands before the last ``/``.  Where the engine knows persons
by their names, a sender is the person of its name, and whoever starts anew begins a new session of the same
person.  Where the engine knows one worn camera without a name, any sender is that one.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

from collabslam.live.advice import DROPPED, USED
from collabslam.live.clock import ClockEstimator, Exchange
from collabslam.live.views import NO_CLOCK, NOBODY, OTHER, LiveView, sender_of

SILENT = 1.0
"""Seconds of the robot's frames without a view that is used: then another sender may take over."""
SENDERS = 64
"""Senders of whom is counted what becomes of their views."""
SESSIONS, REMEMBERED = 8, 64
"""Sessions of which a clock is known, and those that have ended, of each worn camera."""


class Sender:
    """Who sends the views of one worn camera.

    One that starts anew takes the place of its earlier session at once; another one, when no view of the
    session at work was used for `SILENT` seconds of the robot's frames.
    """

    def __init__(self) -> None:
        self.session: str | None = None
        """The one at work."""
        self._clocks: dict[str, ClockEstimator] = {}
        self._ended: deque[str] = deque(maxlen=REMEMBERED)
        self._since = -float("inf")
        self.used = -float("inf")
        """Time of the last frame that used a view of this camera, seconds."""

    def clock(self, session: str) -> ClockEstimator:
        """A session's clock; of too many, the oldest that is not at work is forgotten."""
        if session not in self._clocks:
            if len(self._clocks) >= SESSIONS:
                del self._clocks[next(s for s in self._clocks if s != self.session)]
            self._clocks[session] = ClockEstimator()
        return self._clocks[session]

    def is_at_work(self, session: str, now: float) -> bool:
        """Whether views of this session are used, one of which comes at the time ``now`` of the robot."""
        if session != self.session and self._takes_over(session, now):
            self.session, self._since = session, now
        return session == self.session

    def _takes_over(self, session: str, now: float) -> bool:
        if session in self._ended:
            return False
        if self.session is None:
            return True
        if sender_of(self.session) != sender_of(session):
            return now - max(self._since, self.used) > SILENT
        self._ended.append(self.session)
        self._clocks.pop(self.session, None)
        return True


class Senders:
    """The senders of all worn cameras.

    Parameters
    ----------
    names : iterable of str
        Of the engine's worn cameras, "" for a single one.
    same_clock : bool
        Whether stamps are the robot's own time, so that no clock is needed.
    """

    def __init__(self, names: Iterable[str], *, same_clock: bool = False) -> None:
        self.dropped: Counter[str] = Counter()
        """Views that are not used, by reason."""
        self.counts: dict[str, Counter[str]] = {}
        """What became of the views of each sender, as `advice` counts it; of the first `SENDERS` of them."""
        self._each = {name: Sender() for name in names}
        self._same_clock = same_clock

    def person_of(self, session: str) -> str | None:
        """The name of whoever sends in a session; None if that is nobody whose camera is known."""
        if "" in self._each:
            return ""
        name = sender_of(session)
        return name if name in self._each else None

    def exchange(self, session: str, exchange: Exchange) -> None:
        """Learn of a sender's clock."""
        name = self.person_of(session)
        if name is not None:
            self._each[name].clock(session).add(exchange)

    def timed(self, view: LiveView, now: float | None) -> tuple[str, float, float] | None:
        """Whose view it is, when it was taken by the robot's clock, and the standard deviation of that.

        Parameters
        ----------
        view : LiveView
        now : float or None
            Time of the robot's last frame, seconds, if there was any.

        Returns
        -------
        tuple of (str, float, float), or None
            Name, seconds, seconds; None if the view is not used, which is counted.
        """
        found = self._timed(view, now)
        if isinstance(found, str):
            self.drop(view.session, found)
            return None
        return found

    def drop(self, session: str, reason: str) -> None:
        """A view of this session is not used."""
        self.dropped[reason] += 1
        self._count(session, f"{DROPPED}{reason}")

    def used(self, t: float, names: Iterable[str]) -> None:
        """The frame at ``t`` seconds used views of the worn cameras of these names."""
        for name in names:
            sender = self._each[name]
            sender.used = t
            if sender.session is not None:
                self._count(sender.session, USED)

    def _count(self, session: str, what: str) -> None:
        name = sender_of(session)
        if name in self.counts or len(self.counts) < SENDERS:
            self.counts.setdefault(name, Counter())[what] += 1

    def heard(self, t: float) -> dict[str, bool]:
        """By name, whether a view was used within the last `SILENT` seconds before ``t``."""
        return {name: t - of.used <= SILENT for name, of in self._each.items()}

    @property
    def sessions(self) -> dict[str, str]:
        """The sessions at work, by person."""
        return {name: of.session for name, of in self._each.items() if of.session is not None}

    def _timed(self, view: LiveView, now: float | None) -> tuple[str, float, float] | str:
        """As `timed`; why it is not used, if it is not."""
        name = self.person_of(view.session)
        if name is None:
            return NOBODY
        sender = self._each[name]
        at = (view.stamp, 0.0) if self._same_clock else sender.clock(view.session).robot_time(view.stamp)
        if at is None:
            return NO_CLOCK
        if not sender.is_at_work(view.session, at[0] if now is None else now):
            return OTHER
        return name, *at

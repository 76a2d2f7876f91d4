"""Views of all persons on their way to the filter: those of each wait and are timed by themselves.

A sender is called as its sessions say: what stands before the last ``/``.  Where the engine knows persons
by their names, a sender is the person of its name; each has a session and a clock, and whoever starts anew
begins a new session of the same person.  Where the engine knows one worn camera without a name, any sender is
that one, and another takes over once it is silent (see `WaitingViews`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from collabslam.live.clock import Exchange
from collabslam.live.views import NOBODY, LiveView, TimedView, WaitingViews, sender_of


class WaitingPersons:
    """The `WaitingViews` of each person.

    Parameters
    ----------
    names : iterable of str
        Of the engine's worn cameras, "" for a single one.
    same_clock : bool
        Whether stamps are the robot's own time, so that no clock is needed.
    """

    def __init__(self, names: Iterable[str], *, same_clock: bool = False) -> None:
        self._each = {name: WaitingViews(same_clock=same_clock) for name in names}
        self._strangers: Counter[str] = Counter()

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
            self._each[name].exchange(session, exchange)

    def add(self, view: LiveView, now: float | None) -> bool:
        """Let a view wait, at the time ``now`` of the robot's last frame, if any; False if it is dropped."""
        name = self.person_of(view.session)
        if name is None:
            self._strangers[NOBODY] += 1
            return False
        return self._each[name].add(view, now)

    def take(self, t: float) -> dict[str, TimedView]:
        """Of each person the newest view that was taken before the frame at ``t`` or with it."""
        found = {name: waiting.take(t) for name, waiting in self._each.items()}
        return {name: view for name, view in found.items() if view is not None}

    def refuse(self, name: str, reason: str) -> None:
        """Count a person's view that was taken and could not be used."""
        self._each[name].refuse(reason)

    @property
    def dropped(self) -> Counter[str]:
        """Views of all that were dropped, by reason."""
        return sum((waiting.dropped for waiting in self._each.values()), self._strangers.copy())

    @property
    def reordered(self) -> int:
        """Views that came after a later one of the same sender."""
        return sum(waiting.reordered for waiting in self._each.values())

    @property
    def sessions(self) -> dict[str, str]:
        """The sessions at work, by person."""
        return {name: of.session for name, of in self._each.items() if of.session is not None}

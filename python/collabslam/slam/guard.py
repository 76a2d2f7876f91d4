"""Who may use an engine, and what is left of a call that breaks off: one thread at a time, all or nothing.

An interrupt (Ctrl-C) may come between any two lines, also between those that undo what was done.  So what
was kept when a call began is never changed and can be taken again: whoever uses the engine next undoes it
first, should the undoing itself have been interrupted.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from collabslam._core import Filter
from collabslam.errors import BusyError
from collabslam.slam.state import PersistentState

P = ParamSpec("P")
R = TypeVar("R")


class Guard:
    """The lock of one engine, and what its filter and its parts were when a call began.

    Parameters
    ----------
    core : Filter
    parts : list of PersistentState
    """

    def __init__(self, core: Filter, parts: list[PersistentState]) -> None:
        self.lock = threading.Lock()
        self._filter, self._parts = core, parts
        self._kept: list[dict[str, Any]] = []
        self.broken = False
        """Whether the engine is to be undone before anybody uses it."""

    def begin(self) -> None:
        """Keeps what `undo` needs."""
        self._filter.checkpoint()
        self._kept = [part.attributes() for part in self._parts]

    def repair(self) -> None:
        """Makes the engine what it was when the last call began, if that one broke off."""
        if self.broken:
            self._filter.rollback()
            for part, kept in zip(self._parts, self._kept, strict=True):
                vars(part).update(kept)
            self.broken = False

    def ask(self) -> None:
        """Raises BusyError if somebody is at work."""
        if self.lock.locked():
            raise BusyError(
                "The engine is at work in another thread; give each thread its own Slam, or let them take "
                "turns (threading.Lock)."
            )


class Guarded(Protocol):
    """Something with a guard."""

    _guard: Guard


Engine = TypeVar("Engine", bound=Guarded)
Method = Callable[Concatenate[Engine, P], R]


def alone(method: Method[Engine, P, R]) -> Method[Engine, P, R]:
    """A method that no other thread may come between; raises BusyError if one is at work already."""

    @functools.wraps(method)
    def guarded(engine: Engine, /, *arguments: P.args, **options: P.kwargs) -> R:
        guard = engine._guard
        guard.ask()
        with guard.lock:
            guard.repair()
            return method(engine, *arguments, **options)

    return guarded


def all_or_nothing(method: Method[Engine, P, R]) -> Method[Engine, P, R]:
    """As `alone`; whatever the method raises, the engine is what it was before the call."""

    @functools.wraps(method)
    def guarded(engine: Engine, /, *arguments: P.args, **options: P.kwargs) -> R:
        guard = engine._guard
        guard.ask()
        begun = False
        try:
            with guard.lock:
                guard.repair()
                guard.begin()
                begun = True
                return method(engine, *arguments, **options)
        except BaseException:
            if begun:
                guard.broken = True
                with guard.lock:
                    guard.repair()
            raise

    return guarded

"""One thread at a time may use an engine, and a call that breaks off leaves it as it was.

An interrupt (Ctrl-C) can come between any two lines, even while a broken call is being undone.  So the state
kept at the start of a call is never changed: if undoing was itself interrupted, the next call undoes again.
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
    """The lock of one engine, and the state of its filter and its parts when the last call began.

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
        """Keeps what `repair` needs."""
        self._filter.checkpoint()
        self._kept = [part.attributes() for part in self._parts]

    def repair(self) -> None:
        """Takes the engine back to where the last call began, if that call broke off."""
        if self.broken:
            self._filter.rollback()
            for part, kept in zip(self._parts, self._kept, strict=True):
                vars(part).update(kept)
            self.broken = False

    def ask(self) -> None:
        """Raises BusyError if a call is running in another thread."""
        if self.lock.locked():
            raise BusyError(
                "The engine is at work in another thread; give each thread its own Slam, or let them take "
                "turns (threading.Lock)."
            )


class Guarded(Protocol):
    """An engine that has a guard."""

    _guard: Guard


Engine = TypeVar("Engine", bound=Guarded)
Method = Callable[Concatenate[Engine, P], R]


def alone(method: Method[Engine, P, R]) -> Method[Engine, P, R]:
    """A method that runs alone; raises BusyError if another thread is in the engine."""

    @functools.wraps(method)
    def guarded(engine: Engine, /, *arguments: P.args, **options: P.kwargs) -> R:
        guard = engine._guard
        guard.ask()
        with guard.lock:
            guard.repair()
            return method(engine, *arguments, **options)

    return guarded


def all_or_nothing(method: Method[Engine, P, R]) -> Method[Engine, P, R]:
    """As `alone`; if the method raises anything, the engine is as it was before the call."""

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

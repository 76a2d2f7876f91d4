"""One thread at a time may use an engine, and a call that breaks off leaves it as it was.

An interrupt (Ctrl-C) can come between any two lines, even while a broken call is being undone.  So the state
kept at the start of a call is never changed: if undoing was itself interrupted, the next call undoes again.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from collabslam._core import Filter, Turn
from collabslam.slam.state import PersistentState

P = ParamSpec("P")
R = TypeVar("R")


class Guard:
    """Whose turn it is in one engine, and the state of its filter and its parts when the last call began.

    Parameters
    ----------
    core : Filter
    parts : list of PersistentState
    """

    def __init__(self, core: Filter, parts: list[PersistentState]) -> None:
        self.turn = Turn()
        self._filter, self._parts = core, parts
        self._kept: list[dict[str, Any]] = []
        self.broken = False
        """Whether the engine is to be undone before anybody uses it: a call began and did not end."""

    def begin(self) -> None:
        """Keeps what `repair` needs."""
        self._filter.checkpoint()
        self._kept = [part.attributes() for part in self._parts]
        self.broken = True

    def repair(self) -> None:
        """Takes the engine back to where the last call began, if that call broke off."""
        if self.broken:
            self._filter.rollback()
            for part, kept in zip(self._parts, self._kept, strict=True):
                part.go_back(kept)
            self.broken = False


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
        with guard.turn:
            guard.repair()
            return method(engine, *arguments, **options)

    return guarded


def all_or_nothing(method: Method[Engine, P, R]) -> Method[Engine, P, R]:
    """As `alone`; if the method raises anything, the engine is as it was before the call."""

    @functools.wraps(method)
    def guarded(engine: Engine, /, *arguments: P.args, **options: P.kwargs) -> R:
        guard = engine._guard
        with guard.turn:
            guard.repair()
            guard.begin()
            try:
                result = method(engine, *arguments, **options)
            except BaseException:
                guard.repair()
                raise
            guard.broken = False
            return result

    return guarded

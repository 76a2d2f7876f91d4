"""Work that runs beside the frames, in a thread of its own."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")

_NICENESS = 8
"""Of the thread: on a core that it shares with the frames it gets a seventh, until somebody waits for it."""


class BackgroundTask(Generic[T]):
    """One piece of work at a time; whoever wants what it gives waits for it.

    Work is a function that changes nothing anybody else sees, and is known by the object that it was begun
    for: what another one was begun for before is forgotten.
    """

    def __init__(self) -> None:
        self._now: tuple[object, _Work[T]] | None = None

    def begin(self, wanted: object, work: Callable[[], T]) -> None:
        """Begins the work for ``wanted``, unless it was begun."""
        self._begun(wanted, work)

    def result(self, wanted: object, work: Callable[[], T]) -> T:
        """What the work for ``wanted`` gives; raises what it raised."""
        return self._begun(wanted, work).result()

    def _begun(self, wanted: object, work: Callable[[], T]) -> _Work[T]:
        if self._now is None or self._now[0] is not wanted:
            self._now = wanted, _Work(work)
        return self._now[1]


class _Work(Generic[T]):
    """A function that has been called in a thread."""

    def __init__(self, work: Callable[[], T]) -> None:
        self._work = work
        self._given: list[T] = []
        self._raised: BaseException | None = None
        self._thread = threading.Thread(target=self._run_aside, name="collabslam-background")
        self._thread.start()

    def result(self) -> T:
        self._thread.join()
        if self._raised is None and not self._given:
            self._run()  # a process that was forked has none of its parent's threads
        if self._raised is not None:
            raise self._raised
        return self._given[0]

    def _run_aside(self) -> None:
        if sys.platform == "linux":  # elsewhere niceness is a whole process's
            with contextlib.suppress(OSError):  # a sandbox may forbid it
                os.nice(_NICENESS)
        self._run()

    def _run(self) -> None:
        try:
            self._given = [self._work()]
        except BaseException as error:
            self._raised = error

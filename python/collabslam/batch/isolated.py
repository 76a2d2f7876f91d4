"""Work in a child process of its own, with a time limit for each piece: where it dies, one piece has failed.

The child is a fresh interpreter, whatever the parent is (a worker of a cluster may start no process of
Python's own kind), and ends itself when its parent is gone.  One that has done all it was asked waits for
more: starting an interpreter and loading the package takes as long as a short replay.  Pieces and answers are
pickles of this package's own making, through pipes.  Needs a system with ``select`` on pipes: not Windows.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import pickle
import select
import signal
import struct
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from collabslam.batch.processes import ONE_THREAD, end_with_parent, use_one_thread
from collabslam.errors import CollabslamError
from collabslam.formats.worker_process import started

_LENGTH = struct.Struct("<Q")


_idle: list[subprocess.Popen[bytes]] = []
"""Children that wait for more; a list's ``pop`` and ``append`` are whole, whatever threads do."""


class Died(RuntimeError):
    """A child process ended, or was ended, before its piece of work was done."""


class Stop:
    """Ends the children of all calls that share it: those at work, and from then on each that begins."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._busy: set[subprocess.Popen[bytes]] = set()
        self.is_set = False

    def set(self) -> None:
        """Their pieces have `Died`."""
        with self._lock:
            self.is_set = True
            for child in self._busy:
                child.kill()

    def begins(self, child: subprocess.Popen[bytes]) -> None:
        """A child is at work from now on."""
        with self._lock:
            self._busy.add(child)
            if self.is_set:
                child.kill()

    def ends(self, child: subprocess.Popen[bytes]) -> bool:
        """It no longer is; whether it was left alone."""
        with self._lock:
            self._busy.discard(child)
            return not self.is_set


def why(error: Exception) -> str:
    """What became of a piece of work, for people."""
    return str(error) if isinstance(error, (Died, CollabslamError)) else repr(error)


def isolated(
    function: Callable[..., Any],
    pieces: Sequence[tuple[Any, ...]],
    seconds: float,
    stop: Stop | None = None,
) -> Generator[Any, None, None]:
    """Calls a function with each of the pieces, in order, in a child process and a new one after each death.

    Parameters
    ----------
    function : callable
        Of a module, so that the child finds it by name.
    pieces : sequence of tuple
        Arguments of each call.
    seconds : float
        Limit of each call.
    stop : Stop, optional
        What ends it from another thread.

    Yields
    ------
    object
        What the function returned, or the exception that it raised, or the `Died` that says what became of
        the child.
    """
    left, stop = list(pieces), stop or Stop()
    while left:
        child, whole = _child(), False
        stop.begins(child)
        try:
            for answer in _answers(child, function, left, seconds):
                left.pop(0)
                whole = not left and not isinstance(answer, Died)
                yield answer
        finally:
            if stop.ends(child) and whole:
                _idle.append(child)
            else:
                _end(child)


@contextlib.contextmanager
def asking(jobs: int) -> Iterator[tuple[ThreadPoolExecutor, Stop]]:
    """Threads that ask children, and what ends these; where the body raises, nobody waits for them."""
    stop = Stop()
    with ThreadPoolExecutor(jobs) as threads:
        try:
            yield threads, stop
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            stop.set()
            raise


def _child() -> subprocess.Popen[bytes]:
    """One that waits, or a new one."""
    with contextlib.suppress(IndexError):  # none is left
        while True:
            child = _idle.pop()
            if child.poll() is None:
                return child
            _end(child)
    return subprocess.Popen(
        started(__name__),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, **ONE_THREAD, "PYTHONPATH": os.pathsep.join(sys.path)},
    )


@atexit.register
def _end_idle() -> None:
    while _idle:
        _end(_idle.pop())


def _end(child: subprocess.Popen[bytes]) -> None:
    child.kill()
    child.wait()
    for pipe in (child.stdin, child.stdout):
        with contextlib.suppress(OSError):
            pipe.close()  # type: ignore[union-attr]


def _answers(
    child: subprocess.Popen[bytes], function: Callable[..., Any], pieces: Sequence[Any], seconds: float
) -> Iterator[Any]:
    """Answers of a child up to its death, which is the last one."""
    assert child.stdin is not None
    assert child.stdout is not None
    with contextlib.suppress(BrokenPipeError):
        _send(child.stdin.fileno(), (function, list(pieces), os.getpid()))
    try:
        for _ in range(len(pieces)):
            yield _receive(child.stdout.fileno(), time.monotonic() + seconds)
    except TimeoutError:
        yield Died(f"it took longer than {seconds:g} s")
    except EOFError:
        yield Died(f"its process ended with the code {child.wait()}")


def one(
    function: Callable[..., Any],
    arguments: tuple[Any, ...],
    seconds: float,
    stop: Stop | None = None,
) -> Any:
    """What one call returns in a child process, as of `isolated`; raises what it raises, or `Died`."""
    (answer,) = isolated(function, [arguments], seconds, stop)
    if isinstance(answer, Exception):
        raise answer
    return answer


def _send(pipe: int, content: Any) -> None:
    data = pickle.dumps(content)
    with os.fdopen(pipe, "wb", closefd=False) as file:
        file.write(_LENGTH.pack(len(data)) + data)


def _receive(pipe: int, until: float | None = None) -> Any:
    (length,) = _LENGTH.unpack(_read(pipe, _LENGTH.size, until))
    return pickle.loads(_read(pipe, length, until))


def _read(pipe: int, count: int, until: float | None) -> bytes:
    parts = []
    while count:
        wait = None if until is None else max(0.0, until - time.monotonic())
        if not select.select([pipe], [], [], wait)[0]:
            raise TimeoutError
        part = os.read(pipe, min(count, 1 << 20))
        if not part:
            raise EOFError
        parts.append(part)
        count -= len(part)
    return b"".join(parts)


def _work() -> None:
    """The child: answers through what was standard output, which from now on is standard error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends it
    answers = os.dup(1)
    os.dup2(2, 1)
    use_one_thread()
    watched = False
    with contextlib.suppress(EOFError, BrokenPipeError):  # the parent is gone
        while True:
            function, pieces, parent = _receive(0)
            if not watched:
                end_with_parent(parent)
                watched = True
            for arguments in pieces:
                try:
                    answer = function(*arguments)
                except Exception as error:
                    answer = _as_sent(error)
                _send(answers, answer)


def _as_sent(error: Exception) -> Exception:
    """An exception that arrives whatever its class is made of; of a fault, people see the traceback."""
    if not isinstance(error, CollabslamError):
        traceback.print_exc()
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(repr(error))
    return error


if __name__ == "__main__":
    _work()

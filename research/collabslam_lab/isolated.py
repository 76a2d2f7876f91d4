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
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from collabslam_lab.processes import ONE_THREAD, end_with_parent, use_one_thread

_LENGTH = struct.Struct("<Q")


_idle: list[subprocess.Popen[bytes]] = []
"""Children that wait for more; a list's ``pop`` and ``append`` are whole, whatever threads do."""


class Died(RuntimeError):
    """A child process ended, or was ended, before its piece of work was done."""


def isolated(
    function: Callable[..., Any], pieces: Sequence[tuple[Any, ...]], seconds: float
) -> Iterator[Any]:
    """Calls a function with each of the pieces, in order, in a child process and a new one after each death.

    Parameters
    ----------
    function : callable
        Of a module, so that the child finds it by name.
    pieces : sequence of tuple
        Arguments of each call.
    seconds : float
        Limit of each call.

    Yields
    ------
    object
        What the function returned, or the `Died` that says what became of the child.

    Raises
    ------
    Exception
        What the function raised.
    """
    left = list(pieces)
    while left:
        child, whole = _child(), False
        try:
            for answer in _answers(child, function, left, seconds):
                left.pop(0)
                if isinstance(answer, BaseException) and not isinstance(answer, Died):
                    raise answer
                whole = not left and not isinstance(answer, Died)
                yield answer
        finally:
            if whole:
                _idle.append(child)
            else:
                _end(child)


def _child() -> subprocess.Popen[bytes]:
    """One that waits, or a new one."""
    with contextlib.suppress(IndexError):  # none is left
        while True:
            child = _idle.pop()
            if child.poll() is None:
                return child
            _end(child)
    return subprocess.Popen(
        [sys.executable, "-m", __name__],
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


def one(function: Callable[..., Any], arguments: tuple[Any, ...], seconds: float) -> Any:
    """What one call returns in a child process; raises what it raises, or `Died`."""
    answer = next(isolated(function, [arguments], seconds))
    if isinstance(answer, Died):
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
                    answer = error
                _send(answers, answer)


if __name__ == "__main__":
    _work()

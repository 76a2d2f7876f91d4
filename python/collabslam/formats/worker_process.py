"""A helper process that is asked over pipes; `worker_limits` is its other end."""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import time
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from collabslam.formats.worker_limits import LENGTH

_HOME = str(Path(__file__).resolve().parents[2])
_OURS = os.pathsep.join(filter(None, (_HOME, os.environ.get("PYTHONPATH"))))
"""Where the process finds this package, however this one did."""


_START = (
    "import sys; sys.path[:1] == [''] and sys.path.pop(0); sys.argv.pop(0); "
    "import runpy; runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)"
)


def started(module: str, *words: str) -> list[str]:
    """The command that runs a module, as ``python -m``, but never what lies where it is started, as a cv2.py.

    It is what ``-P`` does from Python 3.11 on.
    """
    return [sys.executable, "-c", _START, module, *words]


class WorkerDied(Exception):
    """A helper process ended, or answers nothing."""


class WorkerProcess:
    """A module that runs as a process of its own, and ends with this object.

    Parameters
    ----------
    module : str
        With a ``main`` that ends in `worker_limits.serve`.
    words : str
        Its command line.
    environment : mapping, optional
        Of it, beside our own.
    """

    def __init__(self, module: str, *words: str, environment: Mapping[str, str] | None = None) -> None:
        self._process = subprocess.Popen(
            started(module, *words),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            env={**os.environ, "PYTHONPATH": _OURS, **(environment or {})},
            start_new_session=True,  # Ctrl-C is for whoever asks
        )
        self._ended = weakref.finalize(self, _end, self._process)
        assert self._process.stdin is not None
        os.set_blocking(self._process.stdin.fileno(), False)

    def ask(self, data: bytes, patience: float) -> bytes:
        """The answer, waited for so many seconds.

        Raises
        ------
        WorkerDied
            If there is none.  Then, and if the wait is broken off, nothing can be asked any more.
        """
        until = time.monotonic() + patience
        try:
            self._write(LENGTH.pack(len(data)) + data, until)
            (length,) = LENGTH.unpack(self._read(LENGTH.size, until))
            return self._read(length, until)
        except BaseException:
            self.kill()
            raise

    def _write(self, data: bytes, until: float) -> None:
        stream, sent = self._process.stdin, 0
        assert stream is not None
        while sent < len(data):
            _, ready, _ = select.select([], [stream], [], max(0.0, until - time.monotonic()))
            try:
                sent += (stream.write(data[sent:]) or 0) if ready else self._died()
            except (OSError, ValueError) as error:
                raise WorkerDied from error

    def _died(self) -> int:
        raise WorkerDied

    def _read(self, count: int, until: float) -> bytes:
        stream = self._process.stdout
        assert stream is not None
        parts = bytearray()
        while len(parts) < count:
            ready, _, _ = select.select([stream], [], [], max(0.0, until - time.monotonic()))
            part = stream.read(count - len(parts)) if ready else b""
            if not part:
                self._died()
            parts += part
        return bytes(parts)

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()

    def close(self) -> None:
        """End the process, and wait for that."""
        self._ended()


def _end(process: subprocess.Popen[Any]) -> None:
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(OSError):
                stream.close()

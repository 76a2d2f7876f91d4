"""Output into a pipe that nobody reads any more, as in ``collabslam ... | head``, is dropped silently.

Standard output that cannot be written for another reason (a full disk) is an error; standard error has nobody
to tell it to.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import Any

from collabslam.errors import DataError


class _Quiet:
    """A text stream that goes on as if nothing had happened when its reader is gone.

    Parameters
    ----------
    stream : file
    told : bool
        Raise DataError when it cannot be written for another reason.
    """

    def __init__(self, stream: Any, *, told: bool) -> None:
        self._stream, self._told = stream, told

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """As of any text stream."""
        try:
            self._stream.write(text)
        except OSError as error:
            self._drop(error)
        return len(text)

    def flush(self) -> None:
        """As of any text stream."""
        try:
            self._stream.flush()
        except OSError as error:
            self._drop(error)

    def _drop(self, error: OSError) -> None:
        """From now on, and with what is held back, into nothing; the interpreter's last flush too."""
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, self._stream.fileno())
        os.close(nothing)
        if self._told and not isinstance(error, BrokenPipeError):
            raise DataError(
                f"The output cannot be written ({error.strerror}); send it to another place."
            ) from error


def _occupy() -> None:
    """Lead descriptors 0 to 2 nowhere where whoever started the program has closed them.

    The next file to be opened would be one of them, and take what others print.
    """
    for number, mode in enumerate((os.O_RDONLY, os.O_WRONLY, os.O_WRONLY)):
        if _is_closed(number):
            nothing = os.open(os.devnull, mode)  # the lowest that is free
            if nothing != number:
                os.dup2(nothing, number)
                os.close(nothing)


def _is_closed(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return True
    return False


@contextlib.contextmanager
def quiet_pipes() -> Iterator[None]:
    """Closed pipes are not an error while the block runs: work goes on, and its exit status is its own.

    Nor are standard streams that were closed before the program began, as ``>&-`` does.

    Raises
    ------
    DataError
        From printing, if standard output cannot be written for another reason; further output is dropped.
    """
    _occupy()
    before = sys.stdout, sys.stderr
    with open(os.devnull, "w", encoding="utf-8") as nothing:
        sys.stdout = _Quiet(before[0] or nothing, told=True)
        sys.stderr = _Quiet(before[1] or nothing, told=False)
        try:
            yield
        finally:
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
            sys.stdout, sys.stderr = before

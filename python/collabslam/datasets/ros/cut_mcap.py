"""MCAP files that were cut, as a recorder that is killed leaves them: read as far as they are whole."""

from __future__ import annotations

import io
import os
import struct
import warnings
from pathlib import Path
from typing import Any

from collabslam.datasets.gate import tell
from collabslam.errors import DataError

_MAGIC = b"\x89MCAP0\r\n"
_END = b"\x02" + struct.pack("<QQQI", 20, 0, 0, 0) + _MAGIC
"""A footer without a summary: all before it is read from the first record on."""

_HOLD_MESSAGES = (5, 6)
"""Records of one message, and of a chunk of them."""


class _Ended(io.RawIOBase):
    """The first bytes of a file, and `_END` after them."""

    def __init__(self, path: Path, length: int) -> None:
        self._file, self._length, self._at = path.open("rb"), length, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._length + len(_END)}[whence]
        self._at = start + offset
        return self._at

    def readinto(self, buffer: Any) -> int:
        if self._at < self._length:
            self._file.seek(self._at)
            data = self._file.read(min(len(buffer), self._length - self._at))
        else:
            data = _END[self._at - self._length :][: len(buffer)]
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)

    def close(self) -> None:
        self._file.close()
        super().close()


class _Cut(type(Path())):  # type: ignore[misc]
    """A path that opens as `_Ended` does."""

    length: int

    def open(self, *_: Any, **__: Any) -> Any:
        return io.BufferedReader(_Ended(Path(os.fspath(self)), self.length))


def as_far_as_whole(path: Path) -> Path:
    """A path to read a bag's file by: an MCAP file that lacks its end is read without it, with a warning.

    Raises
    ------
    DataError
        If nothing of it is whole.
    """
    if path.suffix != ".mcap":
        return path
    size = path.stat().st_size
    with path.open("rb") as file:
        begins = file.read(len(_MAGIC)) == _MAGIC
        file.seek(max(0, size - len(_MAGIC)))
        if not begins or file.read() == _MAGIC:
            return path
        whole, messages = len(_MAGIC), False
        while True:
            file.seek(whole)
            head = file.read(9)
            after = whole + 9 + int.from_bytes(head[1:], "little")
            if len(head) < 9 or head[0] in (0, 2) or after > size:  # nothing written, or a footer without end
                break
            whole, messages = after, messages or head[0] in _HOLD_MESSAGES
    if not messages:
        raise DataError(
            f"The bag {path} is cut before any of it is whole; 'mcap recover' mends what can be mended."
        )
    cut = _Cut(path)
    cut.length = whole
    tell("passed over", f"the last {size - whole} bytes (the file is cut; 'mcap recover' mends it)", path)
    warnings.warn(
        f"The bag {path} is cut: its last {size - whole} bytes are left out ('mcap recover' mends it).",
        stacklevel=2,
    )
    return cut

"""The one place that reads and writes whole files.

Reading opens regular files only: a pipe would wait for ever, a device has no end.  Writing goes beside a
file's place first, so that none is ever half written.
"""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterable
from pathlib import Path

from collabslam.errors import DataError

LARGEST = 1 << 30
"""Bytes that a file may have which is read as a whole; a day of frames has fewer."""
PART = ".part"
"""How the name of a file ends that is being written; one that stays was left by a process that was killed."""


def read_bytes(path: Path, most: int = LARGEST) -> bytes:
    """The content of a regular file.

    Parameters
    ----------
    path : Path
    most : int
        Bytes that it may have; a sparse file promises any number.

    Raises
    ------
    OSError
        If it cannot be read.
    DataError
        If it is larger, or a pipe, a socket, a device or a folder; it is not waited for.
    """
    # Without O_NONBLOCK a pipe that nobody writes to would hold us here.
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        found = os.fstat(handle)
        require_regular(path, found.st_mode)
        if found.st_size > most:
            raise DataError(
                f"{path} has {found.st_size >> 20} MB, more than the {most >> 20} MB that such a file may "
                "have; give the file that is meant."
            )
        with os.fdopen(handle, "rb", closefd=False) as file:
            return file.read()
    finally:
        os.close(handle)


def read_text(path: Path) -> str:
    """The text of a regular UTF-8 file without its byte order mark; raises UnicodeDecodeError as well."""
    return read_bytes(path).decode("utf-8-sig").replace("\r\n", "\n")


def require_regular(path: Path, mode: int | None = None) -> None:
    """Check that a file is a regular one, so that opening it neither waits nor does anything.

    Parameters
    ----------
    path : Path
    mode : int, optional
        Of the open file; looked up otherwise, and then a missing file is left to whoever opens it.

    Raises
    ------
    DataError
        If it is a pipe, a socket, a device or a folder.
    """
    if mode is None:
        try:
            mode = os.stat(path).st_mode
        except OSError:
            return
    if not stat.S_ISREG(mode):
        raise DataError(
            f"{path} is not a regular file (a pipe, a device or a folder); give a file on a disk."
        )


def remove_parts(folder: Path, names: Iterable[str]) -> None:
    """Remove what killed processes left of the files of these names."""
    for name in names:
        for part in folder.glob(f".{name}.*{PART}"):
            part.unlink(missing_ok=True)


def try_place(path: Path) -> None:
    """Makes sure that a file can be written later, at the end of long work; nothing is left behind.

    Raises
    ------
    DataError
        If a folder, a pipe or a device is in its place, or its folder can neither be made nor written.
    """
    beside = _beside(path)
    try:
        _check_replaceable(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.touch()
        beside.unlink()
    except OSError as error:
        raise _unwritable(path, error) from error


def write_text(path: Path, text: str) -> None:
    """Write a whole text file; raises DataError as `write_bytes` does."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, data: bytes, *, durable: bool = False) -> None:
    """Write a whole file beside its place, then move it there.

    Parameters
    ----------
    path : Path
    data : bytes
    durable : bool
        Wait until the disk has it, so that it outlives a loss of power.

    Raises
    ------
    DataError
        If the file cannot be written, or a folder, a pipe or a device is in its place: none is replaced.
    """
    beside = _beside(path)
    try:
        _check_replaceable(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("wb") as file:
            file.write(data)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            beside.unlink()


class LineFile:
    """A text file that grows: each line goes to the system in one piece, and nothing is held back.

    Parameters
    ----------
    path : Path
        Of a file that is there; lines are added to its end.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("ab", buffering=0)
        self._length = self._file.tell()

    def append(self, line: str) -> None:
        """Add a line.

        Raises
        ------
        DataError
            If it cannot be written whole (the disk is full); the file ends with the line before.
        """
        data = f"{line}\n".encode()
        try:
            written = 0
            while written < len(data):  # a full disk takes a part before it says so
                written += self._file.write(data[written:])
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(self._length)
            raise _unwritable(self._path, error) from error
        self._length += len(data)

    def sync(self) -> None:
        """Bring what was written to the disk; raises DataError if it cannot be done."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise _unwritable(self._path, error) from error

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _check_replaceable(path: Path) -> None:
    """Raises DataError if something that is not a regular file is in a file's place."""
    if path.exists() and not path.is_file():
        raise DataError(
            f"The file {path} cannot be written (a folder, a pipe or a device is in its place); give another "
            "place."
        )


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}{PART}")


def _unwritable(path: Path, error: OSError) -> DataError:
    return DataError(
        f"The file {path} cannot be written ({error.strerror}); free disk space or give another place."
    )

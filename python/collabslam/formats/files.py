"""The one place that reads and writes whole files.

Reading opens regular files only: a pipe would wait for ever, a device has no end.  Writing goes beside a
file's place first, so that none is ever half written.
"""

from __future__ import annotations

import contextlib
import errno
import glob
import os
import secrets
import stat
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from collabslam.errors import DataError

LARGEST = 1 << 30
"""Bytes that a file may have which is read as a whole; a day of frames has fewer."""
T = TypeVar("T")
PART = ".part"
"""How the name of a file ends that is being written; one that stays was left by a process that was killed."""
_NAMED = 40
"""Letters of a file's name that are in the name of what is beside it."""


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
    check_name(path)
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


def check_name(path: Path) -> None:
    """Raises DataError if nothing can be called so, or the name goes round in a circle of links."""
    named = f"No file can be called {str(path)[:80]!r}"
    if "\0" in str(path):
        raise DataError(f"{named}; give a name without a zero byte.")
    try:
        os.stat(path)
    except UnicodeEncodeError as error:
        raise DataError(f"{named}; give a name of whole characters.") from error
    except OSError as error:
        if error.errno in (errno.ENAMETOOLONG, errno.ELOOP):
            raise DataError(f"{named} ({error.strerror}); give another one.") from error


def read_text(path: Path) -> str:
    """The text of a regular file, UTF-8, or UTF-16 with its mark; raises UnicodeDecodeError as well."""
    data = read_bytes(path)
    marked = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    return _text(data, "utf-16" if marked else "utf-8-sig")


def _text(data: bytes, encoding: str) -> str:
    return data.decode(encoding).replace("\r\n", "\n")


def read_own_text(path: Path) -> str:
    """The text of a file of a result folder, UTF-8; DataError if it is missing, or no text any more."""
    try:
        return _text(read_bytes(path), "utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is not a text"
        raise DataError(
            f"The file {path} cannot be read ({why}); the folder is damaged: run it again, into another one."
        ) from error


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
        for part in folder.glob(f".{glob.escape(name[:_NAMED])}.*{PART}"):
            part.unlink(missing_ok=True)


def try_place(path: Path) -> None:
    """Makes sure that a file can be written later, at the end of long work; nothing is left behind.

    Raises
    ------
    DataError
        If a folder, a pipe or a device is in its place, or its folder can neither be made nor written.
    """
    try:
        _check_replaceable(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        beside, handle = made_beside(path, PART, _new_file)
        os.close(handle)
        beside.unlink()
    except OSError as error:
        raise _unwritable(path, error) from error


def write_text(path: Path, text: str) -> None:
    """Write a whole text file; raises DataError as `write_bytes` does."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, data: bytes, *, durable: bool = False, private: bool = False) -> None:
    """Write a whole file beside its place, then move it there.

    Parameters
    ----------
    path : Path
        A link there is replaced, not followed.
    data : bytes
    durable : bool
        Wait until the disk has it, so that it outlives a loss of power.
    private : bool
        Only its owner may read it.

    Raises
    ------
    DataError
        If the file cannot be written, or a folder, a pipe or a device is in its place: none is replaced.
    """
    beside = None
    if not os.path.islink(path):  # a link is replaced, wherever it leads
        check_name(path)
    try:
        _check_replaceable(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        beside, handle = made_beside(path, PART, lambda place: _new_file(place, 0o600 if private else 0o666))
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        if beside is not None:
            with contextlib.suppress(OSError):
                beside.unlink()


def made_beside(path: Path, ending: str, make: Callable[[Path], T]) -> tuple[Path, T]:
    """What ``make`` makes at a place beside ``path``, and that place, whose name nobody can know before.

    Parameters
    ----------
    path : Path
    ending : str
        Of the name: ``.NAME.RANDOM`` and this.
    make : callable
        Makes something new at a place, as ``os.mkdir`` does, and raises FileExistsError where something is.
    """
    while True:
        beside = path.with_name(f".{path.name[:_NAMED]}.{secrets.token_hex(8)}{ending}")
        with contextlib.suppress(FileExistsError):
            return beside, make(beside)


def _new_file(path: Path, mode: int = 0o666) -> int:
    """A handle of a file that was not there, neither as a link."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    return os.open(path, flags, mode)


class LineFile:
    """A text file that grows: each line goes to the system in one piece, and nothing is held back.

    Parameters
    ----------
    path : Path
        Of a regular file that is there; lines are added to its end.

    Raises
    ------
    DataError
        If it is none: a link is not followed, and a pipe not waited for.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        flags = os.O_WRONLY | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        try:
            handle = os.open(path, flags | getattr(os, "O_BINARY", 0))
        except OSError as error:
            raise _unwritable(path, error) from error
        self._file = os.fdopen(handle, "ab", buffering=0)
        try:
            require_regular(path, os.fstat(handle).st_mode)
        except DataError:
            self._file.close()
            raise
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


def open_lines(*paths: Path) -> list[LineFile]:
    """A `LineFile` of each, or none of them; raises DataError."""
    with contextlib.ExitStack() as opened:
        files = []
        for path in paths:
            files.append(LineFile(path))
            opened.callback(files[-1].close)
        opened.pop_all()
    return files


def _check_replaceable(path: Path) -> None:
    """Raises DataError if something that is not a regular file is in a file's place."""
    if path.exists() and not path.is_file():
        raise DataError(
            f"The file {path} cannot be written (a folder, a pipe or a device is in its place); give another "
            "place."
        )


def _unwritable(path: Path, error: OSError) -> DataError:
    return DataError(
        f"The file {path} cannot be written ({error.strerror}); free disk space or give another place."
    )

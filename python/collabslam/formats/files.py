"""The one place that writes whole files: beside their place first, so that none is ever half written."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path

from collabslam.errors import DataError

PART = ".part"
"""How the name of a file ends that is being written; one that stays was left by a process that was killed."""


def remove_parts(folder: Path, names: Iterable[str]) -> None:
    """Remove what killed processes left of the files of these names."""
    for name in names:
        for part in folder.glob(f".{name}.*{PART}"):
            part.unlink(missing_ok=True)


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
        If the file cannot be written.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}{PART}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("wb") as file:
            file.write(data)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError as error:
        raise DataError(
            f"The file {path} cannot be written ({error.strerror}); give another place."
        ) from error
    finally:
        with contextlib.suppress(OSError):
            beside.unlink()

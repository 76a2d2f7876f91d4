"""The one place that writes whole files: beside their place first, so that none is ever half written."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from collabslam.errors import DataError


def write_text(path: Path, text: str) -> None:
    """Write a whole text file; raises DataError as `write_bytes` does."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, data: bytes) -> None:
    """Write a whole file beside its place, then move it there.

    Raises
    ------
    DataError
        If the file cannot be written.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.write_bytes(data)
        os.replace(beside, path)
    except OSError as error:
        raise DataError(
            f"The file {path} cannot be written ({error.strerror}); give another place."
        ) from error
    finally:
        with contextlib.suppress(OSError):
            beside.unlink()

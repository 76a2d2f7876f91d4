"""A folder that is written beside its place, and moved there once it is whole."""

from __future__ import annotations

import contextlib
import glob
import os
import shutil
from pathlib import Path

from collabslam.formats.files import made_beside

try:
    import fcntl
except ImportError:  # a system without such locks
    fcntl = None  # type: ignore[assignment]

ENDING = ".partial"


class PartialFolder:
    """A new folder ``.NAME.RANDOM.partial`` beside a place.

    What processes that were killed left beside the same place is removed; what another one is writing is not:
    each holds the system's lock on its own.  Methods raise OSError where the system refuses.

    Parameters
    ----------
    place : Path
        Where it goes.

    Attributes
    ----------
    path : Path
        Where it is.
    """

    def __init__(self, place: Path) -> None:
        self._place = place
        place.parent.mkdir(parents=True, exist_ok=True)
        _remove_left(place)
        self.path, _ = made_beside(place, ENDING, os.mkdir)
        self._lock = _locked(self.path)

    def take_place(self, inside: str = "") -> None:
        """Move the folder, or the one of a name in it, to its place; an earlier one there goes."""
        if self._place.is_symlink() or not self._place.exists():
            os.replace(self.path / inside, self._place)
        else:
            shutil.rmtree(self._place)
            os.replace(self.path / inside, self._place)
        self.discard()

    def discard(self) -> None:
        """Remove what is left of it."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
        shutil.rmtree(self.path, ignore_errors=True)


def _locked(folder: Path) -> int | None:
    """A handle that holds the folder's lock until it is closed; None if another process has it."""
    handle = os.open(folder, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
    if fcntl is not None:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(handle)
            return None
    return handle


def _remove_left(place: Path) -> None:
    if fcntl is None:
        return
    for folder in place.parent.glob(f".{glob.escape(place.name[:40])}.{'[0-9a-f]' * 16}{ENDING}"):
        with contextlib.suppress(OSError):
            handle = _locked(folder)
            if handle is not None:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(handle)

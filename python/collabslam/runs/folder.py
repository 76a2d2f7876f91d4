"""The folder that a run writes into: a new one beside earlier results, locked while the run goes on.

Results go into the folder that is asked for.  If an earlier run's results are in it, they are kept, and the
run goes to the first free of ``NAME-2``, ``NAME-3`` and so on beside it; the link ``latest`` there names the
folder of the run that began last.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from collabslam.errors import DataError
from collabslam.formats.files import PART, check_name, made_beside, read_text

try:
    import fcntl
except ImportError:  # a system without such locks
    fcntl = None  # type: ignore[assignment]

CONFIG = "config.yaml"
MARK = "# collabslam settings"
"""How the first line of a result folder's ``config.yaml`` begins."""
LATEST = "latest"


def is_result_folder(folder: Path) -> bool:
    """Whether a run has written into this folder."""
    try:
        return read_text(folder / CONFIG).startswith(MARK)
    except (OSError, UnicodeDecodeError, DataError):
        return False


def numbered(wanted: Path) -> Iterator[Path]:
    """``wanted``, then ``NAME-2``, ``NAME-3`` and so on beside it, without end."""
    wanted = wanted.resolve() if wanted.is_symlink() or not wanted.name else wanted
    yield wanted
    for number in count(2):
        yield wanted.with_name(f"{wanted.name}-{number}")


def claim(wanted: Path, stack: contextlib.ExitStack, *, overwrite: bool, latest: bool = True) -> Path:
    """A folder for a run's results, made if missing and locked until the stack is left.

    Parameters
    ----------
    wanted : Path
    stack : ExitStack
    overwrite : bool
        Take ``wanted`` even if an earlier run's results are in it; they are still there.
    latest : bool
        Let the link ``latest`` name the folder.

    Raises
    ------
    DataError
        If another run is writing into it or into one of its numbered folders, or it holds other things than
        results, or cannot be written.
    """
    check_name(wanted)
    for folder in numbered(wanted):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with contextlib.ExitStack() as trial:
                trial.enter_context(locked(folder))
                if is_result_folder(folder) and not overwrite:
                    continue
                if any(folder.iterdir()) and not is_result_folder(folder):
                    raise DataError(
                        f"The folder {folder} is not empty and holds no collabslam result; give another "
                        "--out."
                    )
                stack.push(trial.pop_all())
        except OSError as error:
            raise unwritable(folder, error) from error
        break
    if latest:
        _name_latest(folder)
    return folder


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keeps other runs out of a folder that exists, until the block ends or the process does.

    The lock is the system's, on the folder itself: it leaves no file, and none is left by a process that was
    killed.  Where the file system knows no locks nothing is kept out.

    Raises
    ------
    DataError
        If another run has the folder.
    """
    if fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise DataError(
                f"Another run is writing into the folder {folder}; wait for its end, or give another --out."
            ) from error
        except OSError:
            pass
        yield
    finally:
        os.close(handle)


def unwritable(folder: Path, error: OSError) -> DataError:
    """What to say of a folder that cannot be written."""
    return DataError(f"The folder {folder} cannot be written ({error.strerror}); give another --out.")


def _name_latest(folder: Path) -> None:
    """Points the link beside the folder to it; what is not a link of ours is left alone."""
    link = folder.absolute().parent / LATEST
    with contextlib.suppress(OSError):
        if link.is_symlink():
            if os.path.dirname(os.readlink(link)):
                return
        elif link.exists():
            return
        beside, _ = made_beside(link, PART, lambda place: os.symlink(folder.absolute().name, place))
        os.replace(beside, link)

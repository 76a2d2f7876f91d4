"""What is said when this program itself is at fault: one sentence, and a file to report."""

from __future__ import annotations

import os
import sys
import tempfile
import traceback
from pathlib import Path

from collabslam.cli import FAULT


def tell_fault(error: Exception, prog: str, *, debug: bool) -> int:
    """Says that an error is a fault of the program, and leaves its traceback where it can be reported from.

    Parameters
    ----------
    error : Exception
        That nobody expected.
    prog : str
    debug : bool
        Show the traceback as well.

    Returns
    -------
    int
        The exit status.
    """
    trace = "".join(traceback.format_exception(error))
    if debug:
        print(trace, file=sys.stderr, end="")
    kept = getattr(error, "kept_in", None) or _keep(trace)
    where = "what --debug shows" if kept is None else str(kept)
    what = " ".join(f"{type(error).__name__}: {error}".split())
    print(
        f"{prog}: fault: {what[:200]}. The program is at fault, not your data: please report this with "
        f"{where}, the command, and what `{prog} --version` says.",
        file=sys.stderr,
    )
    return FAULT


def _keep(trace: str) -> Path | None:
    """The traceback in a file of its own; None where not even that can be written."""
    try:
        handle, name = tempfile.mkstemp(prefix="collabslam-traceback-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(trace)
    except OSError:
        return None
    return Path(name)

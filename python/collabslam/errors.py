"""Errors a user can meet; each message is one sentence that names the fault and the fix."""

from __future__ import annotations

from typing import Any


class CollabslamError(ValueError):
    """Base class of every error that this package raises on purpose.

    Attributes
    ----------
    result : RunResult or None
        Of an error that ended a run: what had been done until then, which was scored and written too.
    """

    result: Any = None


class DataError(CollabslamError):
    """A recording, or one of its files, is missing, broken or inconsistent."""


class SettingsError(CollabslamError):
    """A setting or an option has an unknown name or a value that is not allowed."""


class InputError(CollabslamError):
    """An array or a number given to a function has the wrong shape, type or range."""


class FilterError(CollabslamError):
    """The filter met a numerical state from which it cannot go on."""


class BusyError(CollabslamError):
    """A filter or an engine is used from a second thread while the first one is still at work in it."""


class Terminated(KeyboardInterrupt):
    """The command line was asked to end by SIGTERM; it does what it does for Ctrl-C."""

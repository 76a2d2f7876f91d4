"""Errors a user can meet; each message is one sentence that names the fault and the fix."""

from __future__ import annotations


class CollabslamError(ValueError):
    """Base class of every error that this package raises on purpose."""


class DataError(CollabslamError):
    """A recording, or one of its files, is missing, broken or inconsistent."""


class SettingsError(CollabslamError):
    """A setting or an option has an unknown name or a value that is not allowed."""


class InputError(CollabslamError):
    """An array or a number given to a function has the wrong shape, type or range."""


class FilterError(CollabslamError):
    """The filter met a numerical state from which it cannot go on."""

"""What the persons of a recording may be called, and where only one of them can be asked."""

from __future__ import annotations

import re

from collabslam.errors import CollabslamError, SettingsError
from collabslam.types import Recording, worn_cameras

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,31}")


def person_name(name: object, error: type[CollabslamError]) -> str:
    """``name`` if a person of a recording can be called so; raises ``error`` otherwise.

    Folders, topics and result files are named after it.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise error(
            f"A person cannot be called {name!r}; take up to 32 letters, digits, _ and -, and no - at first."
        )
    return name


def check_alone(recording: Recording) -> None:
    """Raises SettingsError if several persons wear a camera, where only one can be asked."""
    names = list(worn_cameras(recording))
    if len(names) > 1:
        raise SettingsError(
            f"{recording.name} has worn cameras of {', '.join(names)}; choose one, as --worn "
            f"recorded:{names[0]}."
        )

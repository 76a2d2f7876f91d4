"""Where only one of the persons of a recording can be asked."""

from __future__ import annotations

from collabslam.errors import SettingsError
from collabslam.types import Recording, worn_cameras


def check_alone(recording: Recording) -> None:
    """Raises SettingsError if several persons wear a camera, where only one can be asked."""
    names = list(worn_cameras(recording))
    if len(names) > 1:
        raise SettingsError(
            f"{recording.name} has worn cameras of {', '.join(names)}; choose one, as --worn "
            f"recorded:{names[0]}."
        )

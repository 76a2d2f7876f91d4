"""Collaborative monocular SLAM: a robot's camera, helped now and then by a camera that a person wears.

:class:`Slam` takes images and gives poses with covariance; :func:`run` takes a whole recording, which
:func:`open_recording` finds on disk.  :class:`Filter` is the bare filter, without images.  What needs OpenCV
is imported when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from collabslam._core import Camera, Filter, __version__
from collabslam.errors import CollabslamError, DataError, FilterError, InputError, SettingsError

# Bound here and not on first use: else the submodule of the same name would take its place.
from collabslam.run import run
from collabslam.settings import Settings
from collabslam.types import Frame, Status, Target, WornView

if TYPE_CHECKING:
    from collabslam.datasets import attach_worn, open_recording
    from collabslam.engine import Slam, StepResult

__all__ = [
    "Camera",
    "CollabslamError",
    "DataError",
    "Filter",
    "FilterError",
    "Frame",
    "InputError",
    "Settings",
    "SettingsError",
    "Slam",
    "Status",
    "StepResult",
    "Target",
    "WornView",
    "__version__",
    "attach_worn",
    "open_recording",
    "run",
]

_LAZY = {
    "Slam": "collabslam.engine",
    "StepResult": "collabslam.engine",
    "attach_worn": "collabslam.datasets",
    "open_recording": "collabslam.datasets",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_LAZY[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

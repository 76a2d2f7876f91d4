"""Collaborative monocular SLAM: a robot's camera, helped now and then by a camera that a person wears.

:class:`Slam` takes images and gives poses with covariance; :func:`run` takes a whole recording, found on disk
by :func:`open_recording`.  :class:`Filter` is the bare filter, without images.  Everything but
the errors is imported when it is first used, so that the command line answers at once.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from collabslam.errors import (
    BusyError,
    CollabslamError,
    DataError,
    FilterError,
    InputError,
    SettingsError,
)

if TYPE_CHECKING:
    from collabslam._core import Camera, DepthMeasurement, Filter, FilterSettings, WornMeasurement
    from collabslam.datasets import RecordingWriter, Source, WornSpec, attach_worn, open_recording
    from collabslam.images import to_grey
    from collabslam.results import StepResult
    from collabslam.runs.plan import Output
    from collabslam.runs.runner import RunResult, resume, run
    from collabslam.settings.table import Settings
    from collabslam.slam.engine import Slam
    from collabslam.slam.map.saved_map import SavedMap
    from collabslam.targets.kinds import Board, Tag
    from collabslam.types import Frame, Imu, Status, Target, WornView

    __version__: str

__all__ = [
    "Board",
    "BusyError",
    "Camera",
    "CollabslamError",
    "DataError",
    "DepthMeasurement",
    "Filter",
    "FilterError",
    "FilterSettings",
    "Frame",
    "Imu",
    "InputError",
    "Output",
    "RecordingWriter",
    "RunResult",
    "SavedMap",
    "Settings",
    "SettingsError",
    "Slam",
    "Source",
    "Status",
    "StepResult",
    "Tag",
    "Target",
    "WornMeasurement",
    "WornSpec",
    "WornView",
    "__version__",
    "attach_worn",
    "open_recording",
    "resume",
    "run",
    "to_grey",
]

_HOMES = {
    "Board": "targets.kinds",
    "Camera": "_core",
    "DepthMeasurement": "_core",
    "Filter": "_core",
    "FilterSettings": "_core",
    "Frame": "types",
    "Imu": "types",
    "Output": "runs.plan",
    "RecordingWriter": "datasets",
    "RunResult": "runs.runner",
    "SavedMap": "slam.map.saved_map",
    "Settings": "settings.table",
    "Slam": "slam.engine",
    "Source": "datasets",
    "Status": "types",
    "StepResult": "results",
    "Tag": "targets.kinds",
    "Target": "types",
    "WornMeasurement": "_core",
    "WornSpec": "datasets",
    "WornView": "types",
    "__version__": "_core",
    "attach_worn": "datasets",
    "open_recording": "datasets",
    "resume": "runs.runner",
    "run": "runs.runner",
    "to_grey": "images",
}
"""Module that each public name is imported from on first use."""


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import_module("collabslam.extension").check_extension()
    value = getattr(import_module(f"collabslam.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

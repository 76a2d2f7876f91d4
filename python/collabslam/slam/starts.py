"""The ways to start: whether what was given to a `Slam` fits one, asked once, and the start itself."""

from __future__ import annotations

from collections.abc import Mapping

from collabslam._core import Camera, Filter
from collabslam.errors import SettingsError
from collabslam.settings.frontend import FrontendSettings
from collabslam.settings.modes import MODES, SLAM_STARTS
from collabslam.slam.map.free_start import FreeStart
from collabslam.slam.map.odometry_start import OdometryStart
from collabslam.slam.map.saved_map import SavedMap
from collabslam.slam.start import Start
from collabslam.slam.targets.in_map import PrintedTargets
from collabslam.slam.targets.start import TargetStart
from collabslam.targets.kinds import Board, Tag
from collabslam.types import Target


def check_start(
    start: str,
    *,
    mode: str | None = None,
    worn_camera: Camera | Mapping[str, Camera] | None = None,
    target: Target | Tag | Board | None = None,
    map: SavedMap | None = None,
) -> None:
    """Checks what a `Slam` was asked for.

    Parameters
    ----------
    start : str
        One of `modes.SLAM_STARTS`.
    mode : str, optional
        One of `modes.MODES`; None where the settings choose it, which need not fit: a mode that would use a
        worn camera does without one.
    worn_camera, target, map
        As `Slam` takes them.

    Raises
    ------
    SettingsError
        If the start or the mode does not exist, or lacks what it needs.
    """
    if start not in SLAM_STARTS:
        raise SettingsError(f"There is no start '{start}'; use one of {', '.join(SLAM_STARTS)}.")
    if mode is not None and mode not in MODES:
        raise SettingsError(f"There is no mode '{mode}'; use one of {', '.join(MODES)}.")
    asked = "start 'worn'" if start == "worn" else f"mode '{mode}'"
    if not worn_camera and (start == "worn" or (mode or "").startswith("collab")):
        raise SettingsError(
            f"The {asked} needs a worn camera; give worn_camera, its calibration (a recording that has none "
            "can emulate one: --worn), or take the mode 'mono' with another start."
        )
    if start == "target" and target is None:
        raise SettingsError(
            "The start 'target' needs a known target; give one (--tag 36h11:3=0.16, --board "
            "7x5:0.03), or take another start."
        )
    if start == "map" and map is None:
        raise SettingsError("The start 'map' needs a map; give one, or take another start.")
    if start != "map" and map is not None:
        raise SettingsError(f"A map was given but the start is '{start}'; take the start 'map'.")


def start_of(
    name: str,
    *,
    metric: bool,
    core: Filter,
    camera: Camera,
    printed: PrintedTargets,
    target: Target | None,
    mode: str,
    options: FrontendSettings,
) -> Start:
    """The start of that name.

    Parameters
    ----------
    name : str
        One of `modes.SLAM_STARTS`.
    metric : bool
        Whether lengths are metres, as far as a saved map says it.
    core, camera, printed
        As `TargetStart` takes them.
    target : Target or None
        To start from; None for a printed one.
    mode : str
        One of `modes.MODES`.
    options : FrontendSettings
    """
    if name == "target":
        return TargetStart(core, camera, target, printed, options)
    if name == "scale-free":
        return FreeStart(core, camera)
    if name == "odometry":
        return OdometryStart(core, undelayed=mode == "mono-undelayed")
    return Start(name, metric=metric)

"""Whether a mode, a way to start and what was given fit together: asked once, when a `Slam` is made."""

from __future__ import annotations

from collections.abc import Mapping

from collabslam._core import Camera
from collabslam.errors import SettingsError
from collabslam.settings.modes import MODES, SLAM_STARTS
from collabslam.slam.map.saved_map import SavedMap
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

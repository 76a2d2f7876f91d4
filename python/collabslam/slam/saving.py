"""All of an engine as a file holds it, to go on from bit for bit; and its map, to start another one in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from collabslam._core import Camera, Filter
from collabslam.errors import CollabslamError, DataError, InputError
from collabslam.formats.schema import array, data, fields, flag, optional, table, text
from collabslam.frontend.patch import Patch
from collabslam.images import check_mask
from collabslam.results import Loop
from collabslam.settings.modes import SLAM_STARTS
from collabslam.settings.table import STATE as SETTINGS_STATE
from collabslam.settings.table import Settings
from collabslam.slam.map.saved_map import SavedMap
from collabslam.slam.parts import Parts
from collabslam.slam.recovery.inactive_map import InactiveMap
from collabslam.slam.state import check_camera, persistent_parts
from collabslam.slam.submaps.loop_search import Wanted
from collabslam.slam.submaps.submap import Submap
from collabslam.slam.worn.late_views import KeptFrame
from collabslam.slam.worn.wearers import Heard
from collabslam.types import Masks, Target, WornView

KIND, VERSION = "engine state", 25
"""Of the file that `Slam.save` writes; the version counts the changes of what is in it."""
_MASK = array("|b1", None, None)
CLASSES = (Heard, KeptFrame, Loop, InactiveMap, Patch, Submap, Target, Wanted, WornView)
"""Dataclasses that are in it."""
STATE = fields(
    camera=check_camera,
    worn_cameras=table(str, check_camera),
    settings=SETTINGS_STATE,
    start=text(SLAM_STARTS),
    metric=flag,
    mask=optional(_MASK),
    worn_masks=table(str, _MASK),
    filter=data,
    parts=table(str, lambda value, where: None),  # each asks by itself
)
"""What it may hold."""


def state_of(parts: Parts) -> dict[str, Any]:
    """All that the parts know, to be written before the next frame."""
    return {
        "camera": parts.camera.__getnewargs__(),
        "worn_cameras": {name: worn.__getnewargs__() for name, worn in parts.worn_cameras.items()},
        "settings": parts.settings.state(),
        "start": parts.start.name,
        "metric": parts.start.metric,
        "mask": parts.masks.robot,
        "worn_masks": dict(parts.masks.worn),
        "filter": parts.filter.snapshot(),
        "parts": {name: part.state() for name, part in persistent_parts(parts).items()},
    }


def parts_of(state: Mapping[str, Any]) -> Parts:
    """The parts of a `state_of`; raises DataError if it is none."""
    try:
        STATE(state, "engine")
        camera = Camera(*state["camera"])
        worn_cameras = {name: Camera(*worn) for name, worn in state["worn_cameras"].items()}
        mask = state["mask"]
        parts = Parts(
            Filter.restore(state["filter"]),
            camera,
            worn_cameras,
            Settings.from_state(state["settings"]),
            state["start"],
            metric=bool(state["metric"]),
            masks=Masks(
                None if mask is None else check_mask(mask, camera),
                {name: check_mask(one, worn_cameras[name]) for name, one in state["worn_masks"].items()},
            ),
        )
        persistent = persistent_parts(parts)
        if set(state["parts"]) != set(persistent):
            raise DataError("The file holds other parts of an engine; take an earlier one.")
        for name, part in persistent.items():
            part.restore(state["parts"][name])
        if not parts.tracks.knows(parts.filter.features, parts.filter.candidates):
            raise DataError("The file lacks a feature's patch; take an earlier one.")
    except CollabslamError as error:
        raise DataError(f"The state cannot be used. {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DataError("The file holds no state of an engine; take an earlier one.") from error
    return parts


def map_of(parts: Parts) -> SavedMap:
    """The map with all its uncertainty; raises InputError if there is none yet."""
    known = parts.filter.known_map()
    if not len(known.ids):
        raise InputError("There is no map to save yet; run on until the filter has started.")
    return SavedMap(
        parts.camera,
        parts.start.metric,
        known.landmarks,
        known.covariance,
        known.place,
        parts.relocaliser.views(known.ids),
        parts.submaps.chain().handed_over(known.ids),
        parts.printed.in_list(known.ids),
    )


def begin_in(parts: Parts, map: SavedMap) -> None:
    """New parts begin in a map, of which their camera has taken the views."""
    ids = parts.filter.start_from_map(map.landmarks, map.covariance, map.place)
    parts.relocaliser.adopt(ids, map.views)
    parts.known.begin(map.submaps.renamed(dict(enumerate(ids.tolist()))))
    parts.printed.begin(map.targets, ids)

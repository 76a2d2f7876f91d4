"""A map that the camera is not in, but in which it may be found again (METHOD 19)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from collabslam.formats.schema import array, covariance, instance, items, refuse
from collabslam.frontend.patch import Patch
from collabslam.slam.state import PATCH
from collabslam.slam.targets.in_map import check_targets
from collabslam.types import Array, Ids


@dataclass(frozen=True)
class InactiveMap:
    """A map that the camera is not in.

    Attributes
    ----------
    landmarks, covariance, place : ndarray
        As `Filter.known_map` gives them.
    use : (M,) int64
        Landmarks that help to find the camera, by their place in the map.
    points : (M, 3) float64
        Where they are in W, metres.
    views : list of N lists of Patch
        Of each landmark, the first view first.
    targets : dict
        Landmark of each corner (N,) int64 of the printed targets that are in it, by the target's name; -1
        where it is gone.
    """

    landmarks: Array
    covariance: Array
    place: Array
    use: Ids
    points: Array
    views: list[list[Patch]]
    targets: Mapping[str, Ids]


def check_inactive_map(value: Any, where: str) -> None:
    """An `InactiveMap` whose parts fit together."""
    instance(InactiveMap, landmarks=array("<f8", None, 6), place=covariance(6))(value, where)
    count, used = len(value.landmarks), len(value.use) if isinstance(value.use, np.ndarray) else None
    instance(
        InactiveMap,
        covariance=covariance(6 * count),
        use=array("<i8", None),
        points=array("<f8", used, 3),
        views=items(items(PATCH), count),
    )(value, where)
    if ((value.use < 0) | (value.use >= count)).any() or not all(value.views):
        refuse(where, "a map with a view of each landmark")
    check_targets(value.targets, count, where)

"""A map kept in a file: landmarks with their joint covariance, views of them, and the submaps of the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.errors import CollabslamError, DataError
from collabslam.formats.container import read_container, write_container
from collabslam.formats.schema import array, covariance, fields, flag, refuse, table
from collabslam.frontend.describe import SUPPORT
from collabslam.frontend.map_views import in_one_list, in_other_camera
from collabslam.frontend.patch import Patch
from collabslam.frontend.place_recognition import describe_views
from collabslam.results import Loop
from collabslam.slam.state import PATCH, check_camera
from collabslam.slam.submaps.chain import Chain, check_chain
from collabslam.slam.submaps.submap import Submap
from collabslam.slam.targets.in_map import check_targets
from collabslam.types import Array, Ids

KIND, VERSION = "map", 9
CLASSES = (Loop, Patch, Submap)
"""Dataclasses that are in it."""
CONTENT = fields(
    camera=check_camera,
    metric=flag,
    landmarks=array("<f8", None, 6),
    covariance=covariance(None),
    place=covariance(6),
    owner=array("<i8", None),
    pixels=array("|u1", None, None, None),
    uv=array("<f8", None, 2),
    t_wc=array("<f8", None, 4, 4),
    inside=array("<f8", None, 4),
    submaps=check_chain,
    targets=table(str, array("<i8", None)),
)
"""What its file may hold."""


@dataclass(frozen=True)
class SavedMap:
    """A map to start in; see `Slam.saved_map`.

    Attributes
    ----------
    camera : Camera
        That took the views.
    metric : bool
        Whether lengths are metres; after a scale-free start they are not.
    landmarks : (N, 6) float64
        ``x y z theta phi rho`` of each in W (METHOD section 2).
    covariance : (6 N, 6 N) float64
        Their joint covariance.
    place : (6, 6) float64
        Covariance of the map's place in W, (translation, rotation), m^2 and rad^2.
    views : list of N lists of Patch
        At least one of each landmark, the first one first.
    submaps : Chain
        Of the way so far (METHOD 25): in any of them a camera may find itself, too.  The landmarks above are
        0, 1, .. there.
    targets : dict
        Landmark of each corner (N,) int64 of the printed targets that are in it, by the target's name; -1
        for a corner that is not.
    """

    camera: Camera
    metric: bool
    landmarks: Array
    covariance: Array
    place: Array
    views: list[list[Patch]]
    submaps: Chain = field(default_factory=Chain.empty)
    targets: Mapping[str, Ids] = field(default_factory=dict)

    def save(self, path: str | Path) -> None:
        """Write it; raises DataError if the file cannot be written."""
        views, owner = in_one_list(self.views)
        content = {
            "camera": self.camera.__getnewargs__(),
            "metric": self.metric,
            "landmarks": self.landmarks,
            "covariance": self.covariance,
            "place": self.place,
            "owner": owner,
            "pixels": np.stack([v.pixels for v in views]) if views else np.empty((0, 1, 1), np.uint8),
            "uv": np.reshape([v.uv_ref for v in views], (-1, 2)),
            "t_wc": np.reshape([v.t_wc for v in views], (-1, 4, 4)),
            "inside": np.reshape([v.inside for v in views], (-1, 4)),
            "submaps": self.submaps.state(),
            "targets": dict(self.targets),
        }
        write_container(Path(path), KIND, VERSION, content, CLASSES)

    @classmethod
    def load(cls, path: str | Path) -> SavedMap:
        """A map that `save` wrote.

        Raises
        ------
        DataError
            If the file cannot be read, is cut short, altered, of another kind or version.
        """
        content = read_container(Path(path), KIND, VERSION, CLASSES)
        try:
            return _map_of(content)
        except (CollabslamError, TypeError) as error:
            raise DataError(
                f"The file {path} is not a map of collabslam ({error}); save the map again."
            ) from error

    def seen_by(self, camera: Camera) -> SavedMap:
        """The same map with views as another camera would have taken them.

        Landmarks of which that camera's model has no view are left out.
        """
        if camera == self.camera:
            return self
        flat, _ = in_one_list(self.views)
        taken = iter(in_other_camera(flat, self.camera, camera))
        views = [[v for v in [next(taken) for _ in some] if v is not None] for some in self.views]
        kept = np.array([k for k, some in enumerate(views) if some], dtype=np.int64)
        rows = (6 * kept[:, None] + np.arange(6)).ravel()
        lowest = min((int(submap.ids.min(initial=0)) for submap in self.submaps.submaps), default=0)
        names = {k: lowest - 1 - k for k in range(len(self.landmarks))}
        names |= {k: place for place, k in enumerate(kept.tolist())}
        seen = [_seen_by(submap, self.camera, camera) for submap in self.submaps.submaps]
        place = np.full(len(self.landmarks) + 1, -1)  # the last one is of corners that are not there
        place[kept] = np.arange(len(kept))
        return SavedMap(
            camera,
            self.metric,
            self.landmarks[kept],
            self.covariance[np.ix_(rows, rows)],
            self.place,
            [views[k] for k in kept],
            replace(self.submaps, submaps=seen).renamed(names),
            {name: place[corners] for name, corners in self.targets.items()},
        )


def _seen_by(submap: Submap, camera: Camera, other: Camera) -> Submap:
    taken = in_other_camera(submap.patches, camera, other)
    kept = np.array([k for k, patch in enumerate(taken) if patch is not None], dtype=np.int64)
    patches = [patch for patch in taken if patch is not None]
    return submap.of_landmarks(kept, patches, describe_views(patches, SUPPORT))


def _map_of(content: Any) -> SavedMap:
    """The map in a file's content; DataError if it is none."""
    CONTENT(content, "map")
    owner, pixels = content["owner"], content["pixels"]
    count, views = len(content["landmarks"]), len(owner)
    if not count or not (content["landmarks"][:, 5] > 0.0).all():
        refuse("map.landmarks", "at least one, each with an inverse depth above zero")
    for name in ("pixels", "uv", "t_wc", "inside"):
        if len(content[name]) != views:
            refuse(f"map.{name}", f"one for each of {views} views")
    covariance(6 * count)(content["covariance"], "map.covariance")
    if not np.array_equal(np.unique(owner), np.arange(count)) or (np.diff(owner) < 0).any():
        refuse("map.owner", "the landmark of each view, in order")
    lists: list[list[Patch]] = [[] for _ in range(count)]
    for k, i in enumerate(owner.tolist()):
        view = Patch(pixels[k], content["uv"][k], content["t_wc"][k], content["inside"][k])
        PATCH(view, f"map.view {k}")
        lists[i].append(view)
    chain = Chain.of(content["submaps"])
    if not all(submap.described for submap in chain.submaps):
        refuse("map.submaps", "submaps that can be recognised")
    check_targets(content["targets"], count, "map.targets")
    return SavedMap(
        Camera(*content["camera"]),
        content["metric"],
        content["landmarks"],
        content["covariance"],
        content["place"],
        lists,
        chain,
        content["targets"],
    )

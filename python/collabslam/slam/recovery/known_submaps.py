"""The submaps of a map to start in: a lost camera is looked for in all of them (METHOD 25)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from collabslam._core import Camera, adjoint, ray_angles
from collabslam.formats.schema import Check, whole
from collabslam.frontend.map_views import MapViews
from collabslam.frontend.place_recognition import ImageCorners, locate, most_alike
from collabslam.settings.frontend import FrontendSettings
from collabslam.slam.map_change import Recovered
from collabslam.slam.recovery.inactive_map import InactiveMap
from collabslam.slam.recovery.relocalise import Relocaliser
from collabslam.slam.state import PersistentState
from collabslam.slam.submaps.chain import Chain
from collabslam.slam.submaps.submap import Submap
from collabslam.slam.submaps.submaps import Submaps
from collabslam.slam.view import View

STRETCH = 50
"""Submaps that an image is compared with: the next ones in the next image."""
CANDIDATES = 2
"""Of them, those most alike, in which the camera is looked for by patches."""


class KnownSubmaps(PersistentState):
    """Looks for a lost camera in the submaps of the map that it started in.

    Parameters
    ----------
    camera : Camera
        Cs.
    relocaliser : Relocaliser
    submaps : Submaps
    options : FrontendSettings
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {"_count": whole(0), "_next": whole(0)}

    def __init__(
        self, camera: Camera, relocaliser: Relocaliser, submaps: Submaps, options: FrontendSettings
    ) -> None:
        self._camera, self._options = camera, options
        self._relocaliser, self._submaps = relocaliser, submaps
        self._count = self._next = 0

    def begin(self, chain: Chain) -> None:
        """The submaps of an earlier run are known, in its W."""
        self._count = len(chain.submaps)
        self._submaps.begin(chain)

    def attempt(self, view: View) -> Recovered | None:
        """Looks for the camera in some of the submaps, and puts the filter there; None if it is in none."""
        chain = self._submaps.chain()
        count = min(self._count, len(chain.submaps))
        if not count:
            return None
        first = self._next % count
        some = range(first, min(first + STRETCH, count))
        self._next = some.stop
        described = [chain.submaps[k].descriptors for k in some]
        corners = ImageCorners(view.image, self._options, view.hidden)
        for k in most_alike(corners, described)[:CANDIDATES]:
            found = self._in(corners, chain.submaps[some[k]])
            if found is not None and found.other_map is not None:
                self._submaps.found_in(some[k], list(found.other_map))
                return found
        return None

    def left(self) -> None:
        """The filter is in another map now."""
        self._submaps.elsewhere()

    def _in(self, corners: ImageCorners, submap: Submap) -> Recovered | None:
        there = as_map(submap)
        views = MapViews.of(there.points, there.views)
        fix = locate(corners, self._camera, views, submap.descriptors, submap.pose, (0.0,))
        return None if fix is None else self._relocaliser.enter(there, fix)


def as_map(submap: Submap) -> InactiveMap:
    """A submap as a map to be in: its landmarks seen from where it ended, which is its place in W."""
    n, rotation, centre = len(submap.ids), submap.pose[:3, :3], submap.pose[:3, 3]
    rays = submap.points @ rotation.T
    angles, by_rays = ray_angles(rays)
    length = np.linalg.norm(rays, axis=1)
    by_points = np.concatenate([by_rays, -(rays / length[:, None] ** 3)[:, None]], axis=1) @ rotation
    own = submap.covariance.reshape(n, 3, n, 3)
    blocks = np.einsum("iab,ibjc,jdc->iajd", by_points, own, by_points)
    joint = np.zeros((n, 6, n, 6))
    joint[:, 3:, :, 3:] = 0.5 * (blocks + blocks.transpose(2, 3, 0, 1))
    to_w = adjoint(submap.pose)
    place = to_w @ submap.pose_covariance @ to_w.T
    return InactiveMap(
        np.column_stack([np.tile(centre, (n, 1)), angles, 1.0 / length]),
        joint.reshape(6 * n, 6 * n),
        0.5 * (place + place.T),
        np.arange(n),
        rays + centre,
        [[replace(patch, t_wc=submap.pose)] for patch in submap.patches],
        {},
    )

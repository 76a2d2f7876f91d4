"""What is done for a camera that is not where prediction puts it, or that may be back in an earlier map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from collabslam._core import Camera, Filter, UpdateReport
from collabslam.formats.schema import Check, whole
from collabslam.slam.map.size import MapSize
from collabslam.slam.map_change import Recovered
from collabslam.slam.recovery.by_targets import find_by_targets, find_in_inactive
from collabslam.slam.recovery.known_submaps import KnownSubmaps
from collabslam.slam.recovery.relocalise import Relocaliser
from collabslam.slam.recovery.restart import Restart
from collabslam.slam.state import PersistentState
from collabslam.slam.targets.in_map import PrintedTargets
from collabslam.slam.view import View
from collabslam.types import Ids

_ALONE = 3
"""Frames in a row that printed targets alone explain, before the rest of the map in view is wrong."""


class Recovery(PersistentState):
    """By targets and views of the maps that there are, or in a new map where Cf offers one (METHOD 17, 19).

    Parameters
    ----------
    core : Filter
    camera : Camera
        Cs.
    printed : PrintedTargets
    relocaliser : Relocaliser
        Maps in which a camera may be found.
    known : KnownSubmaps
        Submaps that it started with, in which it may be found, too.
    restart : Restart
    size : MapSize
        Whether the map in use is as large as Cf says.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {"_alone": whole(0)}

    def __init__(
        self,
        core: Filter,
        camera: Camera,
        *,
        printed: PrintedTargets,
        relocaliser: Relocaliser,
        known: KnownSubmaps,
        restart: Restart,
        size: MapSize,
    ) -> None:
        self._filter, self._camera, self._printed = core, camera, printed
        self._relocaliser, self._known, self._restart, self._size = relocaliser, known, restart, size
        self._alone = 0

    def attempt(self, view: View, report: UpdateReport, *, followed: bool) -> Recovered | None:
        """After the update of a frame: puts the camera where images say it is; None if it stays where it was.

        An accepted frame may show an earlier map, by a printed target or by views.  One that failed may show
        a target that a map holds; else it is compared with all maps.  A camera that was lost before is looked
        for in the submaps that it started with, too, and if nothing of them is in sight, it may start anew.
        So does one that is in a map whose size Cf contradicts: it can find itself there, but only wrongly.
        Not where wheels were ``followed``, or the map holds a printed target: they tell metres, too.
        """
        if not view.started:
            return None
        speed = float(np.linalg.norm(self._filter.velocity))
        wrong = self._size.contradicted and not (followed or self._holds_targets())
        found = self._restart.attempt(view, wrong=True) if wrong else None
        begun = found is not None
        if found is None:
            found = self._by_targets(view, report)
        if found is None:
            found = self._relocaliser.look_back(view) if report.accepted else self._relocaliser.attempt(view)
        in_submap = False
        if found is None and view.lost and not report.accepted:
            found = self._known.attempt(view)
            in_submap = found is not None
            found = found or (None if wrong else self._restart.attempt(view, wrong=False))
        if found is not None and found.other_map is not None:
            self._alone = 0
            self._size.leave(contradicted=begun, speed=speed)
            self._printed.move(found.targets)
            if not in_submap:
                self._known.left()
        return found

    def _in_its_map(self, view: View, report: UpdateReport) -> Recovered | None:
        """Where printed targets of the map in use put the camera, and what else of it is seen from there.

        What the update began was seen from where the camera is not, and goes.

        Frame after frame nothing else is, where a map is wrong or what it was of has gone: each frame fails
        by it, and none would show that a landmark of it does.
        """
        corners = find_by_targets(self._filter, self._camera, self._printed.in_map())
        if corners is None:
            return None
        self._filter.remove_features(_born(report))
        found = self._relocaliser.seen_from_there(view, corners)
        self._alone = self._alone + 1 if len(found.seen) == len(corners.seen) else 0
        return replace(found, contradicted=self._alone >= _ALONE)

    def _by_targets(self, view: View, report: UpdateReport) -> Recovered | None:
        """Where printed targets put the camera: in its map, if none of that was used, or in another one."""
        lost = not report.accepted
        found = self._in_its_map(view, report) if lost or not report.bearings.accepted.any() else None
        if found is not None:
            return found
        self._alone = 0
        for old in self._relocaliser.inactive:
            if found is not None:
                break
            seen = self._printed.among(old.targets)
            found = find_in_inactive(self._filter, self._camera, seen, self._relocaliser, old, lost=lost)
        return found

    def _holds_targets(self) -> bool:
        return bool(self._printed.in_list(self._filter.landmarks().ids))


def _born(report: UpdateReport) -> Ids:
    """Features that an update began: points with the depth of Cf or of another sensor."""
    ids = np.concatenate([outcomes.born for outcomes in (report.depths, *report.views)])
    return ids[ids >= 0]

"""A new map, which Cf begins, for a camera that is lost or in a map of a wrong size (METHOD 19)."""

from __future__ import annotations

import numpy as np

from collabslam._core import Filter
from collabslam.slam.map.management import MapManager
from collabslam.slam.map.size import MapSize
from collabslam.slam.map_change import Recovered
from collabslam.slam.recovery.relocalise import Relocaliser
from collabslam.slam.status import StatusMonitor
from collabslam.slam.targets.in_map import PrintedTargets
from collabslam.slam.tracking.tracks import TrackingResult
from collabslam.slam.view import View
from collabslam.slam.worn.matcher import WornMatcher
from collabslam.slam.worn.overlaps import Overlaps


class Restart:
    """Makes the map in use inactive and begins another one.

    Parameters
    ----------
    core : Filter
    printed : PrintedTargets
    relocaliser : Relocaliser
        Keeps the map that is left.
    worn : WornMatcher
    map_manager : MapManager
    monitor : StatusMonitor
        Whether the camera has ever been in its map.
    size : MapSize
        How far the camera has gone since Cf confirmed the map's size.
    metric : bool
        Whether the map is in metres: to one of an arbitrary unit none in metres can be tied.
    """

    def __init__(
        self,
        core: Filter,
        *,
        printed: PrintedTargets,
        relocaliser: Relocaliser,
        worn: WornMatcher,
        map_manager: MapManager,
        monitor: StatusMonitor,
        size: MapSize,
        metric: bool,
    ) -> None:
        self._filter, self._printed, self._relocaliser, self._worn = core, printed, relocaliser, worn
        self._map, self._monitor, self._size, self._metric = map_manager, monitor, size, metric

    def attempt(self, view: View, *, wrong: bool) -> Recovered | None:
        """A new map from Cf where prediction puts a lost camera, and its births; None if too few.

        A camera that has never known where it is has nothing to tie a map to.  A map of a ``wrong`` size is
        not made inactive, to be found again, and where it has led the camera since it was right is not known.
        """
        if not (self._metric and self._monitor.found):
            return None
        for given in view.worn:
            matched = self._worn.match(view, given, TrackingResult.nothing(), self._map.in_view)
            if not matched.measured:
                continue
            overlap = Overlaps((matched,))
            old = None if wrong else self._relocaliser.map_in_use(self._printed)
            gone = self._size.gone(self._filter.pose) if wrong else np.zeros((3, 3))
            report = self._filter.restart(matched.observation, gone)
            if report.accepted:
                self._relocaliser.make_inactive(old)
                begun = self._map.begin(view, overlap, report)
                return Recovered(other_map={}, begun=begun, counts=overlap.counts(report))
        return None

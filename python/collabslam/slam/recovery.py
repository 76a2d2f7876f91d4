"""What is done for a camera that is not where prediction puts it, or that may be back in an earlier map."""

from __future__ import annotations

from collabslam._core import Filter, UpdateReport
from collabslam.slam.map_change import Recovered
from collabslam.slam.map_management import MapManager
from collabslam.slam.relocalise import Relocaliser
from collabslam.slam.status import StatusMonitor
from collabslam.slam.tracks import Found
from collabslam.slam.view import View
from collabslam.slam.worn_frame import WornMatcher


class Recovery:
    """Relocalisation in the maps that there are, or else a new map where Cf offers one (METHOD 19).

    Parameters
    ----------
    core : Filter
    relocaliser : Relocaliser
    worn : WornMatcher
    map_manager : MapManager
    monitor : StatusMonitor
    metric : bool
        Whether the map is in metres: to one of an arbitrary unit none in metres can be tied.
    """

    def __init__(
        self,
        core: Filter,
        relocaliser: Relocaliser,
        worn: WornMatcher,
        map_manager: MapManager,
        monitor: StatusMonitor,
        *,
        metric: bool,
    ) -> None:
        self._filter, self._relocaliser, self._worn = core, relocaliser, worn
        self._map, self._monitor, self._metric = map_manager, monitor, metric

    def attempt(self, view: View, report: UpdateReport) -> Recovered | None:
        """After the update of a frame: puts the camera where images say it is; None if it stays where it was.

        An accepted frame may show an earlier map.  One that failed is compared with all maps, and if none of
        them is in sight, a camera that was lost before may start anew.
        """
        if not view.started:
            return None
        if report.accepted:
            return self._relocaliser.look_back(view)
        found = self._relocaliser.attempt(view)
        return self._restart(view) if found is None and view.lost else found

    def _restart(self, view: View) -> Recovered | None:
        """A new map from Cf where prediction puts a lost camera, and its births; None if too few.

        A camera that has never known where it is has nothing to tie a map to.
        """
        if not (self._metric and self._monitor.found):
            return None
        overlap = self._worn.match(view, Found.nothing(), self._map.in_view)
        if overlap.observation is None:
            return None
        old = self._relocaliser.map_in_use()
        report = self._filter.restart(overlap.observation)
        if not report.accepted:
            return None
        self._relocaliser.put_aside(old)
        begun = self._map.begin(view, overlap, report)
        return Recovered(other_map={}, begun=begun, counts=overlap.counts(report))

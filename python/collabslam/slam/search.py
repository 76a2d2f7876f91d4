"""What a frame of Cs shows of what was expected (METHOD 7.2, 7.3), also where wheels or a gyroscope err."""

from __future__ import annotations

from collabslam._core import Filter, Prediction
from collabslam.frontend.search import GATE
from collabslam.settings.frontend import SearchSettings
from collabslam.slam.gyro_monitor import GyroMonitor
from collabslam.slam.status import StatusMonitor
from collabslam.slam.targets.in_map import PrintedTargets
from collabslam.slam.tracking.tracks import TrackingResult, Tracks
from collabslam.slam.view import View


class FrameSearch:
    """Looks for features, candidates and printed targets in an image.

    Parameters
    ----------
    core : Filter
    tracks : Tracks
    printed : PrintedTargets
    monitor : StatusMonitor
    gyro : GyroMonitor
    settings : SearchSettings
    """

    def __init__(
        self,
        core: Filter,
        tracks: Tracks,
        printed: PrintedTargets,
        monitor: StatusMonitor,
        gyro: GyroMonitor,
        settings: SearchSettings,
    ) -> None:
        self._filter, self._tracks, self._printed = core, tracks, printed
        self._monitor, self._gyro, self._settings = monitor, gyro, settings

    def expected(self, view: View) -> Prediction:
        """Features to search, with their predicted pixels.

        Of a lost camera those whose ellipses fit into the largest window: where it might be is soon wider
        than any, and what is found in a part of it proves little.
        """
        expected = self._filter.predict_pixels()
        if view.hidden is not None:
            expected = expected.subset(~view.hidden(expected.uv))
        if not view.lost:
            return expected
        variance = expected.s.diagonal(axis1=1, axis2=2).max(axis=1, initial=0.0)
        return expected.subset(GATE**2 * variance <= self._settings.max_radius**2)

    def search(
        self, view: View, expected: Prediction, *, followed: bool
    ) -> tuple[Prediction, TrackingResult, bool]:
        """What was expected, what the image shows of it, and whether what told the motion is contradicted.

        That is wheels that were ``followed``, as soon as they are contradicted by the map; and a gyroscope,
        if the turn of the whole image contradicts it, too, and has done so before.
        """
        last = self._tracks.last_image
        found = self._look(view, expected)
        if view.lost:
            return expected, found, False
        turned, wrong = self._filter.followed_gyro, False
        least = self._monitor.min_inliers(len(found.searched))
        contradicted = (followed or turned) and self._filter.contradicts_odometry(found.ids, found.uv, least)
        if turned and contradicted:
            wrong = self._gyro.agrees(view, last, self._tracks.last_image) is False
        self._gyro.take(doubted=turned and contradicted and len(found.ids) >= least, contradicted=wrong)
        if (wrong and self._gyro.contradicted_again) or (followed and contradicted):
            return self._after_slip(view, expected, found)
        return expected, found, False

    def again(self, view: View) -> tuple[Prediction, TrackingResult]:
        """The search from another prediction, whatever told it."""
        expected = self.expected(view)
        return expected, self._look(view, expected)

    def _look(self, view: View, expected: Prediction) -> TrackingResult:
        found = self._tracks.search(view, self._filter.pose, expected, self._filter.predict_conditional)
        return self._printed.place(view, expected, found)

    def _after_slip(
        self, view: View, expected: Prediction, found: TrackingResult
    ) -> tuple[Prediction, TrackingResult, bool]:
        """The search as if the wheels may have slipped, if it explains the image; else the one before."""
        self._filter.distrust_odometry()
        kept = self._tracks.attributes()
        wider, again = self.again(view)
        least = self._monitor.min_inliers(len(again.searched))
        if len(again.ids) >= max(least, len(found.ids) // 2, 1):
            return wider, again, True
        self._filter.trust_odometry()
        self._tracks.go_back(kept)
        return expected, found, False

"""What one frame has measured, and what that does to the map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from collabslam._core import Prediction, UpdateReport
from collabslam.slam.diagnostics import recovery_counts, search_counts
from collabslam.slam.map_change import ImagePoints, MapChange, Recovered
from collabslam.slam.tracking.tracks import Found
from collabslam.slam.view import View
from collabslam.slam.worn.overlaps import Overlaps


@dataclass(frozen=True)
class Outcome:
    """Attributes
    ----------
    view : View
    expected : Prediction
        Features that were to be searched.
    found : Found
    overlap : Overlaps
    report : UpdateReport
    recovered : Recovered or None
        How the camera was found where the update failed.
    change : MapChange
    followed : bool
        Whether odometry predicted the frame.
    slipped : bool
        Whether the wheels have slipped.
    turned : bool
        Whether its turn was taken from images (METHOD 27).
    """

    view: View
    expected: Prediction
    found: Found
    overlap: Overlaps
    report: UpdateReport
    recovered: Recovered | None
    change: MapChange
    followed: bool
    slipped: bool
    turned: bool

    @property
    def accepted(self) -> bool:
        """Whether something tells where the camera is."""
        return self.report.accepted or self.recovered is not None or self.turned

    @property
    def found_again(self) -> bool:
        """Whether the camera was found in a map that there was."""
        return self.recovered is not None and self.recovered.begun is None

    @property
    def jumped(self) -> bool:
        """Whether a camera that was not lost is where it cannot be; wheels that predicted may be wrong."""
        jumped = self.recovered is not None and self.recovered.jumped
        return jumped and not (self.view.lost or self.followed)

    @cached_property
    def seen(self) -> ImagePoints:
        """Features that the pose rests on."""
        if self.recovered is not None:
            return self.recovered.seen
        accepted = self.report.bearings.accepted
        return ImagePoints(self.found.ids[accepted], self.found.uv[accepted])

    @property
    def inliers(self) -> int:
        """Measurements that the pose rests on; a start without depth has none but its features."""
        undelayed = 0 if self.view.started else len(self.change.undelayed)
        return len(self.seen) + self.change.with_depth + undelayed

    def counts(self) -> dict[str, Any]:
        """Of the diagnostics."""
        return {
            **search_counts(len(self.expected), self.found, self.report),
            **self.overlap.counts(self.report),
            **recovery_counts(self.recovered),
            **self.change.counts(),
            "accepted": self.inliers,
            "slipped": int(self.slipped),
            "turned": int(self.turned),
        }

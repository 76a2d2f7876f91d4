"""Start of one camera alone whose motion odometry tells (METHOD 23)."""

from __future__ import annotations

import numpy as np

from collabslam._core import Filter
from collabslam.slam.map_change import ImagePoints, MapChange
from collabslam.slam.start import Start
from collabslam.slam.view import View


class OdometryStart(Start):
    """Begins with points of unknown depth, as soon as odometry tells how the camera moves.

    One vague feature starts the filter, and the way tells the depths of candidates: many vague ones would
    put what their depths lack down to the wheels (METHOD 23).

    Parameters
    ----------
    core : Filter
    undelayed : bool
        Whether all of them are features at once, as in the mode ``mono-undelayed``.
    """

    def __init__(self, core: Filter, *, undelayed: bool) -> None:
        super().__init__("odometry")
        self._core, self._undelayed = core, undelayed

    def begin(self, view: View, born: ImagePoints, count: int) -> MapChange:
        """As `Start.begin`."""
        if self._core.odometry_time is None:
            return MapChange(born)
        uv = view.corners.pick(np.empty((0, 2)), count)
        vague = len(uv) if self._undelayed else 1
        first = ImagePoints.born(self._core.add_undelayed(uv[:vague]), uv[:vague])
        if not self._core.started:
            return MapChange()
        rest = uv[vague:]
        return MapChange(undelayed=first, candidates=ImagePoints(self._core.add_candidates(rest), rest))

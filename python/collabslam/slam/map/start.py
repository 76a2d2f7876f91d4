"""How the map begins (METHOD 5): what a frame must show for it, and what the map is then made of."""

from __future__ import annotations

import numpy as np

from collabslam._core import Filter
from collabslam.slam.map_change import ImagePoints, MapChange
from collabslam.slam.state import PersistentState
from collabslam.slam.view import View
from collabslam.types import Array, Image


class Start(PersistentState):
    """Features born with depth begin the map: from the first overlap, or from another sensor's depths.

    In a map of an earlier run nothing has to begin: there the camera is lost at first.

    Parameters
    ----------
    name : str
        One of `modes.SLAM_STARTS`.
    metric : bool
        Whether lengths are metres.
    """

    def __init__(self, name: str, *, metric: bool = True) -> None:
        self.name, self.metric = name, metric

    def begin(self, view: View, born: ImagePoints, count: int) -> MapChange:
        """What the map begins with, if this frame shows it.

        Parameters
        ----------
        view : View
        born : ImagePoints
            Features that were born with depth in this frame.
        count : int
            How many features the view should hold.
        """
        return MapChange(born)

    def others(self, view: View, taken: Array, missing: int, known: int) -> ImagePoints:
        """More features where the view has none, once the map has begun; see `TargetStart.others`."""
        return ImagePoints()

    def residual(self, image: Image, pose: Array) -> float:
        """Pixels by which a pose misplaces what the map began with; NaN where that is not known or seen."""
        return float("nan")


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

"""How the map begins (METHOD 5): what a frame must show for it, and what the map is then made of."""

from __future__ import annotations

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

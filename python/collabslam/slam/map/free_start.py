"""Start of one camera alone: points are followed until their views tell how it has moved (METHOD 5)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from collabslam._core import LARGEST_PIXEL, LAST_TIME, Camera, Filter
from collabslam.formats.schema import Check, array, items, number, optional, refuse
from collabslam.frontend.flow import there_and_back
from collabslam.slam.map_change import ImagePoints, MapChange
from collabslam.slam.start import Start
from collabslam.slam.view import View
from collabslam.types import Array, Image, Mask

_VIEWS = 5
"""That are fitted at most: the first, the last two, and others between."""
_POINTS = 100
"""That are followed at most; more make the start no better."""
_LEVELS, _STOP = 4, (20, 0.01)
"""Of the flow: the start rests on fractions of a pixel, and the reference may be many frames ago."""
_MAX_GAP = 0.5
"""Pixels between a point and itself followed to this frame and back."""
_LEAST_MOTION = 2.0
"""Pixels, by which half of the points must have moved before anything is worked out."""


class FreeStart(Start):
    """Follows the corners of a first image, the reference, until the filter can start from them.

    Where too many are lost before, the present image is the next reference.

    Parameters
    ----------
    core : Filter
    camera : Camera
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_reference": optional(array("|u1", None, None)),
        "_times": items(number(-LAST_TIME, LAST_TIME)),
        "_views": items(array("<f8", None, 2)),
    }

    def __init__(self, core: Filter, camera: Camera) -> None:
        super().__init__("scale-free", metric=False)
        self._core, self._camera = core, camera
        self._reference: Image | None = None
        self._times: tuple[float, ...] = ()
        self._views: tuple[Array, ...] = ()

    def restore(self, state: Mapping[str, Any]) -> None:
        """As `PersistentState.restore`."""
        super().restore(state)
        self._times, self._views = tuple(self._times), tuple(self._views)
        shape = (self._camera.height, self._camera.width)
        if self._reference is not None and self._reference.shape != shape:
            refuse("reference", "an image of this camera")
        if len({len(v) for v in self._views}) > 1 or len(self._views) != len(self._times):
            refuse("views", "of the same points, one for each time")
        if len(self._views) > _VIEWS or any(len(v) > _POINTS for v in self._views):
            refuse("views", "as few as are kept")
        if any(np.abs(v).max(initial=0.0) > LARGEST_PIXEL for v in self._views):
            refuse("views", "pixels")

    def begin(self, view: View, born: ImagePoints, count: int) -> MapChange:
        """As `Start.begin`: starts the filter where the views tell the motion already."""
        return MapChange(self._started(view, min(count, _POINTS)))

    def _started(self, view: View, count: int) -> ImagePoints:
        if self._reference is None:
            return self._refer_to(view, count)
        uv, kept = self._follow(self._reference, view)
        if kept.sum() < count // 2:
            return self._refer_to(view, count)
        uv, views = uv[kept], tuple(v[kept] for v in self._views)
        moved = float(np.median(np.linalg.norm(uv - views[0], axis=1)))
        times, views = _thinned((*self._times, view.t), (*views, uv))
        self._times, self._views = times, views
        if moved < _LEAST_MOTION:
            return ImagePoints()
        ids = self._core.start_from_views(times, np.stack(views))
        if self._core.started:
            self._reference, self._times, self._views = None, (), ()
        return ImagePoints.born(ids, uv)

    def _refer_to(self, view: View, count: int) -> ImagePoints:
        self._reference = view.image.copy()
        self._times, self._views = (view.t,), (view.corners.pick(np.empty((0, 2)), count),)
        return ImagePoints()

    def _follow(self, reference: Image, view: View) -> tuple[Array, Mask]:
        """Where the reference's points are now, and which of them were found."""
        first = self._views[0]
        if not len(first):
            return first, np.empty(0, np.bool_)
        uv, gap = there_and_back(reference, view.image, first, self._views[-1], _LEVELS, _STOP)
        kept = np.asarray(gap <= _MAX_GAP)
        if view.hidden is not None:
            kept[kept] = ~view.hidden(uv[kept])
        return uv, kept


def _thinned(
    times: tuple[float, ...], views: tuple[Array, ...]
) -> tuple[tuple[float, ...], tuple[Array, ...]]:
    """At most `_VIEWS` of them: the one between whose neighbours are nearest in time goes."""
    while len(times) > _VIEWS:
        gaps = [times[k + 1] - times[k - 1] for k in range(1, len(times) - 2)]
        k = 1 + int(np.argmin(gaps))
        times, views = times[:k] + times[k + 1 :], views[:k] + views[k + 1 :]
    return times, views

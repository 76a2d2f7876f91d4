"""Views of Cf that run on a clock of their own, each at the frame nearest to it in time."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from collabslam import _core
from collabslam.datasets.poses import interpolate_track
from collabslam.datasets.wrapped import TOGETHER, WrappedRecording
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Frame, Recording, WornView

REACH = 0.075
"""Seconds from a frame in which a view of Cf at 7 Hz lies; of frames at a lower rate, half their distance."""
_ASKED = 24
"""Frames that tell whether Cf has a clock of its own."""
_KEPT = 32
"""Frames that are kept."""


class AtFrames(WrappedRecording):
    """A recording of one Cf whose frames have the views nearest to them.

    In the recording itself a view comes with the first frame after it, or a later one.  Here a frame has the
    view nearest to it, with ``T_CF`` as it was given, for the view's own time; `moved` tells how Cs moved
    from the frame to then.  Where nothing tells that, the covariance of ``T_CF`` grows by what it may have
    been (`UNKNOWN_SPEED` and `UNKNOWN_TURN`).

    Parameters
    ----------
    base : Recording
    poses : (N, 4, 4) float64, optional
        T_WC of its frames, metres, NaN where unknown.

    Attributes
    ----------
    free : bool
        Whether views are more than 10 ms from the frames that bring them; if not, nothing is changed.
    """

    def __init__(self, base: Recording, poses: Array | None = None) -> None:
        super().__init__(base)
        between = float(np.median(np.diff(base.times))) if len(base) > 1 else 0.0
        self._reach = max(REACH, 0.5 * between)
        self._read = lru_cache(maxsize=_KEPT)(base.frame)
        known = np.zeros(len(base), np.bool_) if poses is None else np.isfinite(poses).all(axis=(1, 2))
        self._stamps: Array = base.times[known]
        self._poses: Array = np.empty((0, 4, 4)) if poses is None else poses[known]
        asked = np.unique(np.linspace(0, len(base) - 1, min(_ASKED, len(base))).astype(int)).tolist()
        late = [frame.t - _taken(view, frame.t) for frame in map(self._read, asked) for view in frame.views]
        self.free = any(abs(seconds) > TOGETHER for seconds in late)
        self._wait = max([0.0, *late]) + self._reach + between

    def frame(self, i: int) -> Frame:
        """Frame ``i`` with the view nearest to it, if one is near."""
        frame = self._read(i)
        return replace(frame, views=tuple(self._nearest(i))) if self.free else frame

    def view(self, i: int) -> WornView | None:
        """That view; None if none is near."""
        return next(iter(self.frame(i).views), None)

    def moved(self, i: int) -> Array:
        """(4, 4) pose of Cs at the time of frame ``i``'s view in Cs at the frame.

        The identity where both are of one time, where there is no view, and where no poses tell.
        """
        worn = self.view(i) if self.free else None
        moved = None if worn is None else self._between(worn, float(self.times[i]))
        return np.eye(4) if moved is None else moved

    def _nearest(self, i: int) -> list[WornView]:
        t, near = float(self.times[i]), list[WornView]()
        for j in range(i, len(self)):
            if j > i + 1 and self.times[j] > t + self._wait:  # as late as views come here
                break
            came = [replace(view, t=_taken(view, float(self.times[j]))) for view in self._read(j).views]
            near += [view for view in came if abs(_taken(view, t) - t) <= self._reach]
            if any(_taken(view, t) >= t for view in came):
                break
        near.sort(key=lambda view: abs(_taken(view, t) - t))
        return [self._at(view, i) for view in near[:1]]

    def _at(self, worn: WornView, i: int) -> WornView:
        """The view as frame ``i`` has it: less certain where nothing tells how Cs moved between the two."""
        t = float(self.times[i])
        if self._between(worn, t) is not None:
            return worn
        sds = np.repeat((_core.UNKNOWN_SPEED, _core.UNKNOWN_TURN), 3) * abs(_taken(worn, t) - t)
        back = _core.adjoint(pose_inverse(worn.t_cf))
        return replace(worn, covariance=worn.covariance + back @ np.diag(sds**2) @ back.T)

    def _between(self, worn: WornView, t: float) -> Array | None:
        """Cs at the time of a view in Cs at ``t``; None if nothing tells it."""
        if abs(_taken(worn, t) - t) <= TOGETHER:
            return np.eye(4)
        if not len(self._stamps):
            return None
        here, there = interpolate_track(self._stamps, self._poses, np.array([t, _taken(worn, t)]))
        moved: Array = pose_inverse(here) @ there
        return moved if np.isfinite(moved).all() else None


def _taken(worn: WornView, t: float) -> float:
    """When a view was taken: with its frame, of time ``t``, if it does not say."""
    return t if worn.t is None else worn.t

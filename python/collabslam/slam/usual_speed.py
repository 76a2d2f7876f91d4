"""How the camera usually goes.

After it has seen nothing that is how it goes, and bounds what it is told (METHOD 28); and it tells which of
two maps has the right size (METHOD 22).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from collabslam._core import LAST_TIME, Filter
from collabslam.formats.schema import Check, array, flag, number, optional
from collabslam.slam.state import PersistentState
from collabslam.types import Array

_FASTER = 1.25
"""Times the usual speed that a camera does not exceed after it has seen nothing."""
_USUAL = 0.9
"""Share of the frames in which it is not faster than usually."""
_LAST, _LEAST = 300, 50
"""Frames that tell the usual speed: the last ones, and how many there must be."""
_BAND, _WIDER = (0.2, 0.8), 1.15
"""Quantiles of the speeds between which one is usual, and by how much more it may be off."""
_NOW = 5
"""Trusted frames that tell how fast it went at last: the very last before a lapse may be wrong already."""
_STEADY = 0.7
"""Least of the slower of them over the faster of a camera that goes at one speed."""
_LEAST_SD = 0.1
"""Of each part of the velocity after frames that showed nothing, as a share of the speed."""
_SURELY = 2.0
"""Standard deviations by which a camera goes slower than usually that has stopped."""
_AFTER = 5.0
"""Seconds after a frame that was refused in which the map's size is in doubt."""


class UsualSpeed(PersistentState):
    """Knows the velocities of frames that were trusted.

    Parameters
    ----------
    core : Filter
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_velocities": array("<f8", None, 3),
        "_refused": optional(number(-LAST_TIME, LAST_TIME)),
        "_slower": flag,
    }

    def __init__(self, core: Filter) -> None:
        self._filter = core
        self._velocities: Array = np.empty((0, 3))  # along its own axes, m/s
        self._refused: float | None = None
        self._slower = False  # it has stopped, say: the map in view showed it

    def most(self, t: float) -> float | None:
        """The greatest speed (m/s) with which a frame at ``t``, which has been predicted, is used.

        Of a camera whose turn a gyroscope tells, after frames in which it saw nothing; None elsewhere.
        """
        if not self._after_lapse(t) or not self._filter.followed_gyro:
            return None
        return _FASTER * float(np.quantile(self._speeds(), _USUAL))

    def doubts(self, t: float) -> bool:
        """Whether a map that grows at ``t`` has its size from the speed alone.

        After frames that a camera did not use, whose turn a gyroscope tells, and which went as usual before;
        not of one that was seen to go slower since.
        """
        return self._after_lapse(t) and not self._slower

    def _after_lapse(self, t: float) -> bool:
        refused = self._refused is not None and t - self._refused <= _AFTER
        return refused and len(self._velocities) >= _LEAST and self._filter.follows_gyro is True

    def _went_as_usual(self) -> bool:
        """Whether the camera goes at one speed, and did so at last: one that was at rest may start."""
        if len(self._velocities) < _LEAST:
            return False
        low, high = self._usual()
        now = float(np.median(self._speeds()[-_NOW:]))
        return bool(low >= _STEADY * high > 0.0 and self.is_usual(now))

    def expect(self, t: float) -> None:
        """Tells the filter, which has predicted a frame at ``t``, how the camera goes unseen.

        Not in a gap of the gyroscope, where it may have turned.
        """
        if self._filter.started and self._filter.followed_gyro and self.doubts(t):
            velocity = np.median(self._velocities, axis=0)
            spread = np.sqrt(np.square(self._velocities - velocity).mean(axis=0))
            least = _LEAST_SD * float(np.linalg.norm(velocity))
            if least > 0.0:  # it is not of a checkpoint of somebody else's
                self._filter.expect_velocity(velocity, np.maximum(spread, least))

    def is_usual(self, speed: float) -> bool | None:
        """Whether the camera goes at a ``speed`` (m/s) as it mostly does; None where that is not known."""
        if len(self._velocities) < _LEAST:
            return None
        low, high = self._usual()
        return bool(low / _WIDER <= speed <= high * _WIDER)

    def take(self, t: float, *, accepted: bool, lost: bool, trusted: bool) -> None:
        """Takes a frame in.

        Parameters
        ----------
        t : float
            Its stamp, seconds.
        accepted : bool
            Whether it was used.
        lost : bool
            Whether the camera is lost: where it is found again, in a map or by Cf, it begins anew.
        trusted : bool
            Whether its status is OK.
        """
        bounded = self.most(t) is not None
        if lost:
            self._refused = None
        elif not accepted and (self._after_lapse(t) or self._went_as_usual()):
            self._refused = t
        if accepted:
            self._slower = self._after_lapse(t) and self._goes_slower()
        if trusted and not bounded:
            now = self._filter.twist[:3]
            self._velocities = np.concatenate([self._velocities, now[None]])[-_LAST:]

    def _goes_slower(self) -> bool:
        """Whether the map in view shows that it goes slower than usually, until it goes as fast again."""
        speed, sd = float(np.linalg.norm(self._filter.twist[:3])), 0.0
        if not self._slower:
            of_velocity = self._filter.pose_and_twist_covariance[6:9, 6:9]
            sd = float(np.sqrt(np.linalg.eigvalsh(of_velocity)[-1]))
        return speed + _SURELY * sd < self._usual()[0]

    def _usual(self) -> tuple[float, float]:
        """Where the usual speeds begin and end, m/s."""
        low, high = np.quantile(self._speeds(), _BAND).tolist()
        return low, high

    def _speeds(self) -> Array:
        return np.asarray(np.linalg.norm(self._velocities, axis=1))

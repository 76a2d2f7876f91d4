"""What is said of a frame: its status, and what the run is degraded for (METHOD 22)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from collabslam._core import Filter
from collabslam.formats.schema import Check, array
from collabslam.slam.consistency_monitor import ATTITUDE, NOTHING, ConsistencyMonitor
from collabslam.slam.frame_outcome import FrameOutcome
from collabslam.slam.gyro_monitor import GyroMonitor
from collabslam.slam.recovery.relocalise import Relocaliser
from collabslam.slam.state import PersistentState
from collabslam.slam.status import StatusMonitor
from collabslam.slam.submaps.submaps import Submaps
from collabslam.types import Status

_UNKNOWN = 0.35
"""Radians of the attitude's standard deviation past which a covariance says little of where the camera is: of
the way from where the attitude was lost 1 - cos(0.35), 6 %, comes short at one of it.
"""
_SECONDS = 1.0
"""A camera that is lost goes on as it did in the last so many seconds in which its frames were trusted."""


class Verdict(PersistentState):
    """Judges frames; a place that is trusted is kept, to be found again and as part of a submap.

    Parameters
    ----------
    core : Filter
    monitor : StatusMonitor
    consistency_monitor : ConsistencyMonitor
    relocaliser : Relocaliser
    submaps : Submaps
    gyro : GyroMonitor
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {"_went": array("<f8", None, 4)}

    def __init__(
        self,
        core: Filter,
        *,
        monitor: StatusMonitor,
        consistency_monitor: ConsistencyMonitor,
        relocaliser: Relocaliser,
        submaps: Submaps,
        gyro: GyroMonitor,
    ) -> None:
        self._filter, self._monitor, self._consistency = core, monitor, consistency_monitor
        self._relocaliser, self._submaps, self._gyro = relocaliser, submaps, gyro
        self._went = np.empty((0, 4))

    def of(self, outcome: FrameOutcome) -> tuple[Status, dict[str, Any]]:
        """The status of a frame, and its diagnostics ``degraded_by`` and ``loops``."""
        view, change = outcome.view, outcome.change
        status = self._judge(
            view.t,
            outcome.inliers,
            accepted=outcome.accepted,
            followed=outcome.followed,
            identified=outcome.recovered is not None and outcome.recovered.identified,
        )
        if view.lost:  # a map that was inconsistent is no better where a lost camera finds itself in it again
            cause = self._consistency.standing()
        else:
            measured = outcome.report, len(outcome.found.ids), outcome.overlap, change
            cause = self._consistency.judge(*measured, jumped=outcome.jumped)
        trusted = status is Status.OK and not outcome.found_again
        if trusted:
            recent = self._went[self._went[:, 0] > view.t - _SECONDS]
            self._went = np.vstack([recent, [view.t, *self._filter.velocity]])
            self._relocaliser.remember(view, self._filter.pose, outcome.seen)
        follows = trusted and cause == NOTHING
        loops = self._submaps.follow(view, outcome.seen.without(change.deleted)) if follows else 0
        if status is Status.OK and cause == NOTHING and self._is_turned():
            cause = ATTITUDE
        if status is Status.OK and cause != NOTHING:
            status = Status.DEGRADED
        return status, {"degraded_by": cause, "loops": loops}

    def _is_turned(self) -> bool:
        """Whether nobody knows where the camera looks, so that its covariance is none."""
        variance = float(np.linalg.eigvalsh(self._filter.pose_covariance[3:, 3:])[-1])
        return variance > _UNKNOWN**2

    def unseen(self, t: float, *, frozen: bool, followed: bool) -> Status:
        """The status of a frame that shows nothing.

        A blank image says that the camera sees nothing; a frozen one says nothing of the camera.  Neither
        says anything against odometry or a gyroscope that was followed.
        """
        if frozen and self._filter.started and self._monitor.is_fresh(t):
            return Status.OK
        told = followed or self._gyro.used
        return self._judge(t, 0, accepted=frozen or told, followed=followed)

    def _judge(
        self, t: float, inliers: int, *, accepted: bool, followed: bool, identified: bool = False
    ) -> Status:
        """Status of the frame; before the start nothing can be said of a pose."""
        if not self._filter.started:
            return Status.NOT_STARTED
        lost = self._monitor.lost
        status = self._monitor.update(
            t,
            inliers,
            accepted=accepted,
            followed=followed,
            turned=self._gyro.used,
            identified=identified,
        )
        if self._monitor.lost and not lost and len(self._went):
            self._filter.go_on_at(np.median(self._went[:, 1:], axis=0))
        return status

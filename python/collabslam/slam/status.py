"""Whether the camera is where its map says: OK, COASTING, LOST."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from collabslam._core import LAST_TIME, LostSettings
from collabslam.formats.schema import Check, flag, number, optional, whole
from collabslam.slam.state import PersistentState
from collabslam.types import Status

_MIN_SHARE = 0.15
"""Least share of the features searched that is accepted in a frame that is used: a few wrong matches pass any
test.  In sight of the map a third and more are accepted, even in blurred frames; after a jump a twentieth.
"""
_FAILED_FRAMES = 3
"""Frames that fail in a row before the camera is lost."""
_TURNED = 3.0
"""As many times as long a camera may see nothing whose turn is told: only its way is uncertain."""
_FRESH = 0.1 - 1e-6  # seconds; a frame at 10 Hz is not


class StatusMonitor(PersistentState):
    """OK: enough accepted matches in this frame.  COASTING: too few, for a short time.  LOST: for longer, and
    from then on until enough are accepted again.

    Parameters
    ----------
    settings : LostSettings
    lost : bool
        Whether the camera is lost to begin with.
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_last_ok": optional(number(-LAST_TIME, LAST_TIME)),
        "_failed": whole(0),
        "lost": flag,
        "found": flag,
    }

    def __init__(self, settings: LostSettings, *, lost: bool = False) -> None:
        self._min_matches = settings.min_matches
        self._seconds = settings.seconds
        self._last_ok: float | None = None
        self._failed = 0
        self.lost = lost
        """Whether the camera was lost after the last frame."""
        self.found = not lost
        """Whether it has ever known where it is."""

    def min_inliers(self, searched: int) -> int:
        """Fewest accepted matches for a frame to be used, by the number of features searched in it.

        A few wrong matches pass any test, so half of a small number is required, and a share of a large one.
        A lost camera needs a full set.  Where hardly any feature is expected nothing is required, unless the
        frame before failed: the camera may have jumped to where it knows nothing.
        """
        share = math.ceil(_MIN_SHARE * searched)
        if self.lost or (self._failed and searched < self._min_matches):
            return max(self._min_matches, share)
        if searched < self._min_matches:
            return 0
        return max(share, min(self._min_matches, searched // 2))

    @property
    def unbroken(self) -> bool:
        """Whether no frame has failed since the last one that was used: images since then hang together."""
        return not self.lost and self._failed == 0

    def is_fresh(self, t: float) -> bool:
        """Whether a frame at ``t`` (seconds) that shows the last image again is as good as the last.

        The camera has delivered nothing new, as some do every now and then, and the pose is less than 0.1 s
        older than one that was OK.
        """
        return not self.lost and self._last_ok is not None and t - self._last_ok < _FRESH

    def update(
        self,
        t: float,
        inliers: int,
        *,
        accepted: bool,
        followed: bool = False,
        turned: bool = False,
        identified: bool = False,
    ) -> Status:
        """Status of the frame at ``t`` (seconds).

        Parameters
        ----------
        inliers : int
            Accepted matches, births with depth included.
        accepted : bool
            Whether the frame was: it had as many as `min_inliers` asks for.
        followed : bool
            Whether odometry carried the camera here: it is not lost then for not having seen anything for
            long.
        turned : bool
            Whether a gyroscope told how it turned: it is lost for that `_TURNED` times as late.
        identified : bool
            Whether points that say themselves which they are have found the camera: few of them are enough
            for it not to be lost.
        """
        if self._last_ok is None:
            self._last_ok = t
        if not accepted:
            self._failed += 1
        elif inliers:  # a frame of which nothing was required does not end a series of failures
            self._failed = 0
        if accepted and inliers >= self._min_matches:
            self._last_ok, self.lost, self.found = t, False, True
            return Status.OK
        if identified:
            self._last_ok, self._failed, self.lost, self.found = t, 0, False, True
            return Status.COASTING
        patience = self._seconds * (_TURNED if turned else 1.0)
        unseen = t - self._last_ok > patience and not followed
        self.lost = self.lost or self._failed >= _FAILED_FRAMES or unseen
        return Status.LOST if self.lost else Status.COASTING

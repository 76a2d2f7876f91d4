"""Whether a gyroscope turns as the images do (METHOD 28)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from collabslam._core import Camera, Filter
from collabslam.formats.schema import Check, array
from collabslam.frontend.flow import FlowImage
from collabslam.frontend.followed import followed_points
from collabslam.results import GyroEstimate
from collabslam.settings.frontend import FlowSettings
from collabslam.slam.state import PersistentState
from collabslam.slam.view import View
from collabslam.types import Array

TOO_MANY = 4
"""Contradicted frames, of the last `_LAST`, from which on it is not followed any more."""
_LAST = 15
_TOLD = 30
"""Frames for which a contradiction is told."""
_MANY = 10
"""Frames of those in which the map alone contradicts it: it may be what moves."""


class GyroMonitor(PersistentState):
    """Asks the images of frames in which the map contradicts the gyroscope, or shows nothing.

    What moves in view contradicts it in the map, too; so the turn of the image as a whole is asked, which
    needs no map and refuses what moves (METHOD 27).

    Parameters
    ----------
    core : Filter
    camera : Camera
        Cs.
    settings : FlowSettings
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_contradicted": array("|b1", None),
        "_doubted": array("|b1", None),
    }

    def __init__(self, core: Filter, camera: Camera, settings: FlowSettings) -> None:
        self._filter, self._camera, self._settings = core, camera, settings
        self._contradicted = self._doubted = np.zeros(0, bool)
        self.used = False
        """Whether it told the turn to the present frame."""

    def predicted(self) -> None:
        """Notes whether it told the turn to a frame that has been predicted."""
        self.used = self._filter.followed_gyro

    def counts(self) -> dict[str, int]:
        """Of the frame's diagnostics: whether it was used, and contradicted; none without one."""
        if self._filter.follows_gyro is None:
            return {}
        contradicted = bool(self._contradicted[-1:].any())
        return {"gyro_used": int(self.used), "gyro_contradicted": int(contradicted)}

    def take(self, *, doubted: bool, contradicted: bool) -> None:
        """Takes in a frame, and drops a gyroscope that is contradicted often.

        Parameters
        ----------
        doubted : bool
            Whether the map contradicts it.
        contradicted : bool
            Whether the turn of the image does, too.
        """
        if self._filter.follows_gyro is None:
            return
        self._doubted = np.append(self._doubted, doubted)[-_TOLD:]
        self._contradicted = np.append(self._contradicted, contradicted)[-_TOLD:]
        if self._filter.follows_gyro and self._contradicted[-_LAST:].sum() >= TOO_MANY:
            self._filter.drop_gyro()

    @property
    def at_odds(self) -> bool:
        """Whether images, or the map in many frames, contradicted it lately."""
        return bool(self._contradicted.sum() > 1 or self._doubted.sum() >= _MANY)

    @property
    def contradicted_again(self) -> bool:
        """Whether images contradicted it in more than one of the last frames: one may show what moves."""
        return bool(self._contradicted[-_LAST:].sum() > 1)

    def estimate(self) -> GyroEstimate | None:
        """What is known of it; None without one."""
        core = self._filter
        followed, bias, clock = core.follows_gyro, core.gyro_bias, core.gyro_clock
        if followed is None or bias is None or clock is None:
            return None
        return GyroEstimate(bias[0], np.sqrt(np.diag(bias[1])), *clock, followed)

    def agrees(
        self, view: View, last: tuple[float, FlowImage] | None, now: tuple[float, FlowImage] | None
    ) -> bool | None:
        """Whether the turn that two images show is the one that the gyroscope told; None if they show none.

        Parameters
        ----------
        view : View
            The frame, predicted and not measured yet.
        last : (float, FlowImage) or None
            Time and image of the frame before.
        now : (float, FlowImage) or None
            Its own.
        """
        if last is None or now is None:
            return None
        answer = self._filter.gyro_agrees(last[0], *self.followed(view, last, now))
        if answer is None:
            # A wrong turn looks for the points where they are not.
            answer = self._filter.gyro_agrees(last[0], *self.followed(view, last, now, still=True))
        return answer

    def followed(
        self,
        view: View,
        last: tuple[float, FlowImage],
        now: tuple[float, FlowImage],
        *,
        still: bool = False,
    ) -> tuple[Array, Array]:
        """Points of an image, and where they are in the next one, from the predicted turn, or from none."""
        turn = np.zeros(3) if still else self._filter.angular_velocity * (view.t - last[0])
        return followed_points((last[1], now[1]), self._camera, turn, self._settings, view.hidden)

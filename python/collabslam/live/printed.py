"""T_CF of views that come without it: from printed targets that both cameras see."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

from collabslam._core import Camera
from collabslam.errors import DataError
from collabslam.slam.engine import Slam
from collabslam.targets.printed import pose_between
from collabslam.types import Array, Board, Image, Tag

KEPT = 12
"""Frames of Cs that are kept for views of their time."""


class PrintedPoses:
    """Measures T_CF with the frame of Cs that is nearest in time.

    Cf stands where it took its view, and the targets stand still; so T_CF relative to that frame is right,
    whatever the clocks say.

    Parameters
    ----------
    camera, worn_camera : Camera
    targets : sequence of Tag and Board
        Boards with one odd and one even number of corners.
    """

    def __init__(self, camera: Camera, worn_camera: Camera, targets: Sequence[Tag | Board]) -> None:
        self._camera, self._worn_camera, self._targets = camera, worn_camera, targets
        self._frames: deque[tuple[float, Image]] = deque(maxlen=KEPT)

    def frame(self, t: float, image: Image) -> None:
        """Keep a frame of Cs."""
        self._frames.append((t, image))

    def pose(self, t: float, worn_image: Image) -> tuple[float, Array, Array] | None:
        """Time of the frame that is nearest to ``t``, T_CF and its covariance; None if no target tells."""
        if not self._frames:
            return None
        nearest, image = min(self._frames, key=lambda kept: abs(kept[0] - t))
        try:
            found = pose_between(image, self._camera, worn_image, self._worn_camera, self._targets)
        except DataError:
            return None
        return nearest, *found


def printed_poses(
    camera: Camera, worn_camera: Camera | None, targets: Sequence[Tag | Board]
) -> PrintedPoses | None:
    """What tells T_CF where both cameras see one of the targets; None if nothing can."""
    if worn_camera is None or not targets:
        return None
    return PrintedPoses(camera, worn_camera, targets)


def make_slam(
    camera: Camera,
    worn_camera: Camera | None,
    targets: Sequence[Tag | Board],
    *,
    start: str = "worn",
    **options: Any,
) -> Slam:
    """An engine that knows the printed targets; options as of `Slam`, which raises SettingsError."""
    first = targets[0] if targets and start == "target" else None
    slam = Slam(camera, worn_camera, start=start, target=first, **options)
    if start != "scale-free":
        for target in targets:
            slam.announce(target)
    return slam

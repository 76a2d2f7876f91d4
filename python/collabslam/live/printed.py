"""T_CF of views that come without it: from printed targets that both cameras see."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.live.tracked import OwnWorlds, shared
from collabslam.live.views import LiveView, OwnPose
from collabslam.slam.engine import Slam
from collabslam.targets.kinds import Board, Tag
from collabslam.targets.printed import Sighting, between, pose_beside, sightings
from collabslam.types import Image, WornView

KEPT = 10
"""Frames of Cs that are kept for the views of ``worn.late`` seconds, but for the last two."""


@dataclass(eq=False)
class _Frame:
    """A frame of Cs, and the targets in it once they were looked for."""

    t: float
    image: Image
    seen: list[Sighting] | None = None


class PrintedPoses:
    """Measures T_CF with the frame of Cs so far that is nearest in time.

    Cf stands where it took its view, and the targets stand still; so T_CF relative to that frame is right,
    whatever the clocks say.  A camera that tracks itself need not see a target at that moment: see `tracked`.

    Parameters
    ----------
    camera : Camera
    worn_cameras : mapping
        Each Cf by name.
    targets : sequence of Tag and Board
        Boards with one odd and one even number of corners.
    late : float
        How late a view may come, seconds.
    """

    def __init__(
        self,
        camera: Camera,
        worn_cameras: Mapping[str, Camera],
        targets: Sequence[Tag | Board],
        late: float,
    ) -> None:
        self._camera, self._worn_cameras, self._targets = camera, worn_cameras, targets
        self._apart = late / KEPT
        self._frames: deque[_Frame] = deque(maxlen=KEPT + 2)
        self._worlds = OwnWorlds()

    def frame(self, t: float, image: Image) -> None:
        """Keep a frame of Cs; of those before, so many as are a share of the time apart."""
        if not self._targets:
            return
        if len(self._frames) > 1 and self._frames[-1].t - self._frames[-2].t < self._apart:
            self._frames.pop()
        self._frames.append(_Frame(t, image))

    def pose(self, name: str, view: LiveView, t: float, worn_image: Image) -> WornView | None:
        """The view, taken at ``t``, with T_CF at the time of a frame; None if no target tells it.

        Parameters
        ----------
        name : str
            Whose.
        view : LiveView
        t : float
            When it was taken by the robot's clock, seconds.
        worn_image : (H, W) uint8
            Decoded.
        """
        if not self._frames:
            return None
        if view.own is not None:
            return self._tracked(name, view.session, view.own, t, worn_image)
        frame = min(self._frames, key=lambda kept: abs(kept.t - t))
        found = pose_beside(self._sightings(frame), worn_image, self._worn_cameras[name])
        return None if found is None else WornView(worn_image, *found, t=frame.t, who=name)

    def _sightings(self, frame: _Frame) -> list[Sighting]:
        """Looked for once, however many views come beside the frame."""
        if frame.seen is None:
            frame.seen = sightings(frame.image, self._camera, self._targets)
        return frame.seen

    def _tracked(self, name: str, session: str, own: OwnPose, t: float, worn_image: Image) -> WornView | None:
        """From the last frame of Cs with a target that the phone ever saw."""
        world = self._worlds.of(session)
        world.move(t, own, sightings(worn_image, self._worn_cameras[name], self._targets))
        of_cf = world.sightings()
        for frame in reversed(self._frames) if of_cf else ():
            both = shared(self._sightings(frame), of_cf)
            if not both:
                continue
            found = [(*between(cs, cf), time_correlated) for cs, cf, time_correlated in both]
            t_cf, covariance, time_correlated = min(found, key=lambda f: float(np.linalg.slogdet(f[1])[1]))
            return WornView(worn_image, t_cf, covariance, time_correlated, frame.t, name)
        return None


def make_slam(
    camera: Camera,
    worn_cameras: Mapping[str, Camera],
    targets: Sequence[Tag | Board],
    *,
    start: str = "worn",
    **options: Any,
) -> Slam:
    """An engine that knows the printed targets; options as of `Slam`, which raises SettingsError."""
    first = targets[0] if targets and start == "target" else None
    slam = Slam(camera, worn_cameras, start=start, target=first, **options)
    if start != "scale-free":
        for target in targets:
            slam.announce(target)
    return slam

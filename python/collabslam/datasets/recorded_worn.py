"""The views of worn cameras in a recording: which frames they come with and how each is read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from collabslam._core import Camera
from collabslam.types import Image, Indices, WornView

WornImages = tuple[Camera, Mapping[int, Callable[[], Image]]]
"""A worn camera's calibration and how its images are read, by frame index, where T_CF is told elsewhere."""


@dataclass(frozen=True)
class RecordedWorn:
    """What a worn camera took.

    Attributes
    ----------
    camera : Camera
        Its calibration.
    views : mapping of frame index to callable
        Reads the view that comes with a frame; None where nothing tells its T_CF.  Raises DataError if it is
        broken.
    """

    camera: Camera
    views: Mapping[int, Callable[[], WornView | None]]

    def of_frames(self, kept: Indices) -> RecordedWorn:
        """The same of these frames alone, which are counted anew."""
        return replace(self, views={k: self.views[i] for k, i in enumerate(kept.tolist()) if i in self.views})

    def with_views(self, change: Callable[[WornView], WornView]) -> RecordedWorn:
        """The same with each view changed once it is read."""

        def read(before: Callable[[], WornView | None]) -> WornView | None:
            view = before()
            return None if view is None else change(view)

        return replace(self, views={i: partial(read, before) for i, before in self.views.items()})


def views_of(worn: Mapping[str, RecordedWorn], i: int) -> tuple[WornView, ...]:
    """The views of frame ``i``, each with the name of whoever wears its camera; raises DataError."""
    found = [(name, of.views[i]()) for name, of in worn.items() if i in of.views]
    return tuple(replace(view, who=name) for name, view in found if view is not None)


class WithWornCameras:
    """What a recording tells of the worn cameras in its ``worn``."""

    worn: Mapping[str, RecordedWorn]

    @property
    def worn_cameras(self) -> dict[str, Camera]:
        """Calibration of each Cf of which the recording holds views, by name."""
        return {name: of.camera for name, of in self.worn.items()}

    @property
    def worn_camera(self) -> Camera | None:
        """That of the first one; None where there is none."""
        return next(iter(self.worn_cameras.values()), None)

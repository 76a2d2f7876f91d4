"""One frame as the parts of the engine see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam._core import WornMeasurement
from collabslam.frontend.detect import Corners, Hidden
from collabslam.types import Image, WornView


@dataclass(frozen=True)
class PlacedWorn:
    """A worn camera's view, as a frame sees it.

    Attributes
    ----------
    worn : WornView
        If it was taken at another time than the frame's, with T_CF between that and the frame.
    captured : WornView or None
        The view as it was taken, if that was at another time.
    """

    worn: WornView
    captured: WornView | None = None

    def stated(self, number: int, t: float) -> WornMeasurement:
        """As the filter takes it at the frame of ``t``, without matches; ``number`` is its camera's."""
        worn = self.captured or self.worn
        none, capture = np.empty((0, 2)), None
        if self.captured is not None and worn.t is not None:
            capture = (worn.t, t)
        return WornMeasurement(
            worn.t_cf,
            worn.covariance,
            np.empty(0, np.int64),
            none,
            none,
            bias=worn.bias,
            capture=capture,
            who=number,
        )


PlacedViews = tuple[tuple[int, PlacedWorn], ...]
"""The views of a frame, each with the number of its worn camera."""


@dataclass(frozen=True)
class View:
    """A frame's input, and where the engine stood before it.

    Attributes
    ----------
    t : float
        Time stamp, seconds.
    image : (H, W) uint8
        Grey image of Cs.
    worn : tuple of (int, PlacedWorn)
        The worn cameras' views, each with the number of its camera.
    hidden : callable or None
        Which pixels of Cs show whoever wears Cf, or what is fixed to the camera; None where all are clear.
    corners : Corners
        Of ``image``.
    started : bool
        Whether there was a map before this frame.
    lost : bool
        Whether the camera was lost before this frame.
    """

    t: float
    image: Image
    worn: PlacedViews
    hidden: Hidden | None
    corners: Corners
    started: bool
    lost: bool

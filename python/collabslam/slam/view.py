"""One frame as the parts of the engine see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam._core import WornMeasurement
from collabslam.frontend.detect import Corners, Hidden
from collabslam.types import Array, Image, WornView


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


@dataclass(frozen=True)
class PlacedCamera:
    """Where a worn camera was when its view was taken.

    Attributes
    ----------
    pose : (4, 4) float64
        T_WF: maps points of F into W, metres.
    covariance : (6, 6) float64
        Of it over (translation, rotation), tangent on the right, m^2 and rad^2.
    measured : bool
        Whether matches of the view tell it; else it is where T_CF says, seen from the pose of Cs.
    t : float
        When that was, seconds, by the clock of Cs.
    matches : int
        Matches of the view that the filter was given.
    clock : tuple of (float, float) or None
        By how much its views are taken after their stamps, by the clock of Cs, as far as the filter
        knows, and the standard deviation of that, seconds; None where the clock is exact.
    """

    pose: Array
    covariance: Array
    measured: bool
    t: float
    matches: int
    clock: tuple[float, float] | None = None


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

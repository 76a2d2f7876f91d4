"""One frame as the parts of the engine see it."""

from __future__ import annotations

from dataclasses import dataclass

from collabslam.frontend.detect import Corners, Hidden
from collabslam.types import Image, WornView


@dataclass(frozen=True)
class View:
    """A frame's input, and where the engine stood before it.

    Attributes
    ----------
    t : float
        Time stamp, seconds.
    image : (H, W) uint8
        Grey image of Cs.
    worn : WornView or None
        The worn camera's view; if it was taken at another time, with T_CF between that and this frame.
    hidden : callable or None
        Which pixels of Cs show whoever wears Cf, or what is fixed to the camera; None where all are clear.
    corners : Corners
        Of ``image``.
    started : bool
        Whether there was a map before this frame.
    lost : bool
        Whether the camera was lost before this frame.
    captured : WornView or None
        The worn camera's view as it was taken, if that was at another time.
    """

    t: float
    image: Image
    worn: WornView | None
    hidden: Hidden | None
    corners: Corners
    started: bool
    lost: bool
    captured: WornView | None = None

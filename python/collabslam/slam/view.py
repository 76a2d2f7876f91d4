"""One frame as the parts of the engine see it."""

from __future__ import annotations

from dataclasses import dataclass

from collabslam.frontend.detect import Corners, Hidden
from collabslam.slam.worn.overlap import Overlap
from collabslam.types import Image


@dataclass(frozen=True)
class View:
    """A frame's input, and where the engine stood before it.

    Attributes
    ----------
    t : float
        Time stamp, seconds.
    image : (H, W) uint8
        Grey image of Cs.
    worn : tuple of Overlap
        The worn cameras' views, before they are matched.
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
    worn: tuple[Overlap, ...]
    hidden: Hidden | None
    corners: Corners
    started: bool
    lost: bool

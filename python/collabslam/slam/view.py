"""One frame as the parts of the engine see it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from collabslam.frontend.detect import Corners, Hidden
from collabslam.frontend.wearer_mask import Outline
from collabslam.results import CELL
from collabslam.slam.worn.overlap import Overlap
from collabslam.types import Image, Mask


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
    wearers : mapping of Outline
        Outlines in view of those who wear a Cf, by name, whether or not somebody is there.
    """

    t: float
    image: Image
    worn: tuple[Overlap, ...]
    hidden: Hidden | None
    corners: Corners
    started: bool
    lost: bool
    wearers: Mapping[str, Outline] = field(default_factory=dict)

    @cached_property
    def left_out(self) -> Mask | None:
        """Which squares of `CELL` pixels are hidden, by their middles: (h, w) bool; None where none is."""
        if self.hidden is None:
            return None
        height, width = (range(CELL // 2, side, CELL) for side in self.image.shape)
        v, u = np.meshgrid(height, width, indexing="ij")
        hidden = self.hidden(np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64))
        return hidden.reshape(u.shape) if hidden.any() else None

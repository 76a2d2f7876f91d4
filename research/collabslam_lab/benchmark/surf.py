"""SURF, the descriptor of the paper, as one more that the pipeline knows while it is compared."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

import cv2
import numpy as np

from collabslam.errors import DataError
from collabslam.frontend.describe import DESCRIPTORS, Descriptors, angle_and_scale, crop_around
from collabslam.types import Array, Image

SURF = "surf"
_SUPPORT = 20.0  # side of SURF's window over its scale


def describe_surf(image: Image, uv: Array, axes: Array, size_px: float) -> Descriptors:
    """SURF (Bay et al., 2008), with its own dominant direction; the scale is that of the map, rounded.

    At scales that are not a whole numbers mahotas (1.4) describes a texture differently when it is turned.

    Parameters
    ----------
    image : (H, W) uint8
    uv : (N, 2) float64
    axes : (N, 2, 2) float64
        Maps offsets in the described window to pixel offsets in the image.
    size_px : float
        Side of the window, pixels.

    Returns
    -------
    (N, 64) float32
        Unit vectors.

    Raises
    ------
    DataError
        If mahotas is missing.
    """
    try:
        from mahotas.features import surf
    except ImportError as error:
        raise DataError(f"This needs mahotas ({error}): pip install './research[surf]'.") from error
    if len(uv) == 0:
        return np.empty((0, 64), dtype=np.float32)
    _, scale = angle_and_scale(axes)
    scales = np.clip(np.round(scale * size_px / _SUPPORT), 1.0, 4.0)
    border = math.ceil(_SUPPORT * float(scales.max()))
    crop, points = crop_around(image, uv, border)
    padded = cv2.copyMakeBorder(crop, border, border, border, border, cv2.BORDER_REPLICATE)
    places = np.column_stack([points[:, ::-1] + border, scales, np.ones((len(uv), 2))])
    return np.asarray(surf.descriptors(padded, places, descriptor_only=True), dtype=np.float32)


@contextmanager
def known_surf() -> Iterator[None]:
    """The pipeline knows `SURF` for a while."""
    with patch.dict(DESCRIPTORS, {SURF: describe_surf}):
        yield

"""Points followed from one image into the next, for the camera's turn between them (METHOD 27)."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.frontend.detect import Hidden
from collabslam.frontend.flow import FlowImage, flow_guess, motion_of
from collabslam.settings.frontend import FlowSettings
from collabslam.types import Array, Image

_CELLS = (5, 4)  # of the image, columns and rows
_MOST = 5  # points of each: the strongest corners of the whole image may all be on somebody who passes
_QUALITY = 0.1  # least response, as a share of the strongest of the cell
_DISTANCE = 12.0  # pixels of the flow's images between two of them
_WINDOW = 35  # pixels of those: blurred images show little in a smaller one


def followed_points(
    images: tuple[FlowImage, FlowImage],
    camera: Camera,
    turn: Array,
    settings: FlowSettings,
    hidden: Hidden | None,
) -> tuple[Array, Array]:
    """Corners of an image that are found in the next one.

    Parameters
    ----------
    images : (FlowImage, FlowImage)
    camera : Camera
        Cs.
    turn : (3,) float64
        How far the camera should have turned in between, a rotation vector along its axes, radians.
    settings : FlowSettings
    hidden : callable, optional
        Which pixels show what is not a landmark, of both images.

    Returns
    -------
    before, now : (N, 2) float64
        Pixels.
    """
    first, second = images
    before = first.factor * _corners(first.image)
    if not len(before):
        return before, before.copy()
    rotation, _ = cv2.Rodrigues(turn)
    seen = camera.project(camera.unproject(before) @ rotation)
    motion = motion_of(before[seen.visible], seen.uv[seen.visible])
    now, ok = flow_guess(first, second, before, settings, motion, _WINDOW)
    if hidden is not None:
        ok &= ~hidden(before)
        ok[ok] = ~hidden(now[ok])
    return before[ok], now[ok]


def _corners(image: Image) -> Array:
    """(N, 2): corners of each part of an image, its pixels."""
    height, width = image.shape
    columns, rows = (
        [side * k // count for k in range(count + 1)]
        for side, count in zip((width, height), _CELLS, strict=True)
    )
    found = [np.empty((0, 2))]
    for top, bottom in pairwise(rows):
        for left, right in pairwise(columns):
            cell = image[top:bottom, left:right]
            corners = cv2.goodFeaturesToTrack(cell, _MOST, _QUALITY, _DISTANCE)
            if corners is not None:
                found.append(corners.reshape(-1, 2) + np.array([left, top]))
    return np.concatenate(found).astype(np.float64)

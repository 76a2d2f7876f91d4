"""Points followed from one image into the next, for the camera's turn between them (METHOD 27)."""

from __future__ import annotations

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.frontend.detect import Hidden
from collabslam.frontend.flow import FlowImage, flow_guess, motion_of
from collabslam.settings.frontend import FlowSettings
from collabslam.types import Array

_MOST = 100  # points
_QUALITY = 0.01  # least response, as a share of the strongest
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
    corners = cv2.goodFeaturesToTrack(first.image, _MOST, _QUALITY, _DISTANCE)
    if corners is None:
        return np.empty((0, 2)), np.empty((0, 2))
    before = first.factor * corners.reshape(-1, 2).astype(np.float64)
    rotation, _ = cv2.Rodrigues(turn)
    seen = camera.project(camera.unproject(before) @ rotation)
    motion = motion_of(before[seen.visible], seen.uv[seen.visible])
    now, ok = flow_guess(first, second, before, settings, motion, _WINDOW)
    if hidden is not None:
        ok &= ~hidden(before)
        ok[ok] = ~hidden(now[ok])
    return before[ok], now[ok]

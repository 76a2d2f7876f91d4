"""The known points of a :class:`~collabslam.types.Target` by their patches (METHOD section 10)."""

from __future__ import annotations

import numpy as np

from collabslam._core import Camera
from collabslam.errors import DataError
from collabslam.frontend.search import FOUND, peak_test, search_around, search_window
from collabslam.settings.frontend import SearchSettings
from collabslam.targets.pose import pose_from_points, project_points
from collabslam.targets.printed import Sighting
from collabslam.types import Image, Target

RADIUS = 10.0
"""Least radius in which a patch of the target is searched, pixels."""
SIGMA = 0.5
"""Standard deviation of a located point, pixels."""
_MIN_SCORE = 0.7  # least correlation of a patch of the target
_MAX_RESIDUAL = 3.0  # pixels, largest distance of a point from its place under the pose found


def find_target(
    image: Image, camera: Camera, target: Target, settings: SearchSettings | None = None
) -> Sighting:
    """Locate a target's patches around their predicted pixels, and the camera's pose from them.

    Parameters
    ----------
    image : (H, W) uint8
    camera : Camera
    target : Target
        Points, patches and the approximate pose; the search covers three standard deviations of its
        covariance, and at least :data:`RADIUS`.
    settings : SearchSettings, optional

    Returns
    -------
    Sighting
        Of the points that were found.

    Raises
    ------
    DataError
        If fewer than four of the points are found where one pose can explain them.
    """
    settings = settings or SearchSettings()
    points = np.asarray(target.points, dtype=np.float64).reshape(-1, 3)
    if len(target.patches) != len(points):
        raise DataError(
            f"The target has {len(points)} points but {len(target.patches)} patches; give one for each."
        )
    predicted, jacobian = project_points(points, camera, np.asarray(target.t_tc, dtype=np.float64))
    spread = jacobian @ np.asarray(target.covariance, dtype=np.float64) @ jacobian.transpose(0, 2, 1)
    window = search_window(settings.max_radius, min_radius=RADIUS, large_radius=settings.max_radius)
    peaks = peak_test(_MIN_SCORE)
    uv = np.full((len(points), 2), np.nan)
    for k, patch in enumerate(target.patches):
        side = min(patch.shape) - (1 - min(patch.shape) % 2)
        template = np.ascontiguousarray(patch[:side, :side])[None]
        found = search_around(image, template, predicted[k : k + 1], spread[k : k + 1], window, peaks)
        if found.code[0] == FOUND:
            # The patch's middle is its point; an even side leaves half a pixel.
            uv[k] = found.uv[0] + (np.array(patch.shape[::-1]) - side) / 2.0
    index = np.flatnonzero(np.isfinite(uv[:, 0]))
    while len(index) >= 4:
        t_tc, covariance = pose_from_points(points[index], uv[index], camera, SIGMA, target.t_tc)
        residual = np.linalg.norm(project_points(points[index], camera, t_tc)[0] - uv[index], axis=1)
        if residual.max() <= _MAX_RESIDUAL:
            return Sighting(None, points[index], uv[index], t_tc, covariance)
        index = np.delete(index, int(np.argmax(residual)))
    raise DataError(
        f"Fewer than four of the target's {len(points)} points were found; check its patches and its "
        "start pose."
    )

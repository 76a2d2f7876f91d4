"""How well two views overlap, judged from their poses alone."""

from __future__ import annotations

import numpy as np

from collabslam._core import Camera
from collabslam.types import Array

DEPTHS = (1.5, 3.0, 5.0)
_GRID = (12, 9)
_PARALLAX = (np.deg2rad(3.0), np.deg2rad(20.0))
_MOST_AXIS_ANGLE = np.deg2rad(35.0)


def grid_points(camera: Camera) -> Array:
    """Points (N, 3), metres in C, on the rays of a grid of pixels at each of `DEPTHS`."""
    columns, rows = _GRID
    u = (np.arange(columns) + 0.5) * camera.width / columns - 0.5
    v = (np.arange(rows) + 0.5) * camera.height / rows - 0.5
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    rays = np.asarray(camera.unproject(uv), dtype=np.float64)
    rays = rays[rays[:, 2] > 1e-3]
    unit_depth = rays / rays[:, 2:]
    return np.concatenate([depth * unit_depth for depth in DEPTHS])


def view_overlap(points: Array, worn_camera: Camera, t_cf: Array) -> float:
    """Share of a view's points that another view sees with a useful parallax.

    A point at a plausible depth counts if it projects into the other image and the rays of the two cameras
    meet in it at 3 to 20 degrees: less says little about depth, more changes the appearance too much to
    match.  Optical axes more than 35 degrees apart count as no overlap.  There is no notion of what hides
    what.

    Parameters
    ----------
    points : (N, 3) array
        From :func:`grid_points` of Cs, metres in C.
    worn_camera : Camera
    t_cf : (4, 4) array
        Maps points of F into C.

    Returns
    -------
    float
        From 0 to 1.
    """
    rotation, centre = t_cf[:3, :3], t_cf[:3, 3]
    if rotation[2, 2] < np.cos(_MOST_AXIS_ANGLE):
        return 0.0
    in_f = (points - centre) @ rotation
    seen = worn_camera.project(in_f).visible
    to_c = np.linalg.norm(points, axis=1)
    to_f = np.linalg.norm(in_f, axis=1)
    cosine = np.sum(points * (points - centre), axis=1) / np.maximum(to_c * to_f, 1e-12)
    parallax = np.arccos(np.clip(cosine, -1.0, 1.0))
    useful = seen & (parallax >= _PARALLAX[0]) & (parallax <= _PARALLAX[1])
    return float(np.mean(useful))

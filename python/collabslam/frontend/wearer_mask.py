"""Where a camera sees whoever wears another one, as T_CF says: a person who walks is not a landmark."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from collabslam._core import Camera
from collabslam.types import Array, Mask

OVER = 0.2
"""Metres of the body above the camera that is worn."""
TRUNK = 0.2, 0.8
"""Metres below the camera from which to which nothing is seen past the middle of a body."""
_NEAREST = 0.9
"""The largest radius, as a share of the way to the middle: a larger one would hide all there is."""


@dataclass(frozen=True)
class Outline:
    """A body as a capsule about a line through the camera that is worn, seen by another one.

    Attributes
    ----------
    head : (3,) float64
        Where the worn camera is, along the axes of the one that sees it, metres.
    down : (3,) float64
        Which way is down there, a unit vector.
    radius : float
        Of the body, metres.
    height : float
        Of the body, metres.
    off : float
        How far it may be from there, metres: the outline is as much wider.
    """

    head: Array
    down: Array
    radius: float
    height: float
    off: float = 0.0

    @property
    def is_possible(self) -> bool:
        """Whether a body can be there: not if the camera that sees it would be inside."""
        return self._distance > self.radius

    @property
    def _distance(self) -> float:
        """From the camera that sees it to the middle line, metres."""
        reach = np.clip(-self.head @ self.down, -OVER, self.height - OVER)
        return float(np.linalg.norm(self.head + reach * self.down))

    @property
    def range(self) -> float:
        """To the middle of the trunk, metres."""
        return float(np.linalg.norm(self.head + np.mean(TRUNK) * self.down))

    def hides(self, camera: Camera, uv: Array) -> Mask:
        """(N,) bool: at which pixels (N, 2) of the camera that sees it the body may be."""
        radius = min(self.radius + self.off, _NEAREST * self._distance)
        return self._covers(camera, uv, -OVER, self.height - OVER, radius)

    def trunk(self, camera: Camera, uv: Array) -> Mask:
        """(N,) bool: at which pixels nothing but the body is seen, if somebody is there."""
        return self._covers(camera, uv, *TRUNK, 0.6 * self.radius)

    def seen_from(self, pose: Array) -> Outline:
        """The same, seen by another camera: ``pose`` (4, 4) maps points of this one into it."""
        rotation = pose[:3, :3]
        return replace(self, head=rotation @ self.head + pose[:3, 3], down=rotation @ self.down)

    def _covers(self, camera: Camera, uv: Array, first: float, last: float, radius: float) -> Mask:
        """Which rays pass within ``radius`` of the middle line from ``first`` to ``last`` metres below Cf."""
        ray = np.reshape(camera.unproject(uv), (-1, 3))
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        top = self.head + first * self.down
        # Both across the ray: the point of the line nearest to it is the one nearest to zero there.
        start = top - (ray @ top)[:, None] * ray
        along = self.down - (ray @ self.down)[:, None] * ray
        square = np.maximum((along * along).sum(axis=1), 1e-12)
        reach = np.clip(-(start * along).sum(axis=1) / square, 0.0, last - first)
        distance = np.linalg.norm(start + reach[:, None] * along, axis=1)
        ahead = (ray * (top + reach[:, None] * self.down)).sum(axis=1) > 0.0
        return np.asarray((distance < radius) & ahead)

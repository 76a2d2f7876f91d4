"""Which way is down: two angles of W with their covariance, and what is level by them.

The level world L has W's origin; its axes are x ahead, y left, z up, and x is where W's camera looked, seen
from above.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from collabslam.geometry import pose, skew
from collabslam.types import Array

GRAVITY = 9.80665
"""m/s^2: the standard's, by which sensors that count in g are made."""
_SIDE = np.eye(3)[:, :2]


@dataclass(frozen=True)
class Level:
    """The direction of up in W, and how well it is known.

    Attributes
    ----------
    up : (3,) float64
        A unit vector along the axes of W.
    covariance : (2, 2) float64
        Of the turns about the level world's x and y, rad^2.
    source : str
        What tells it.
    """

    up: Array
    covariance: Array
    source: str

    @property
    def r_lw(self) -> Array:
        """(3, 3), maps directions of W into the level world."""
        ahead = np.eye(3)[2] - self.up[2] * self.up
        if np.linalg.norm(ahead) < 0.1:  # it looks straight up or down: what is up in the image is ahead
            ahead = -np.eye(3)[1] + self.up[1] * self.up
        x = ahead / np.linalg.norm(ahead)
        return np.stack([x, np.cross(self.up, x), self.up])

    def poses(self, poses: Array, covariances: Array) -> tuple[Array, Array]:
        """T_LC (N, 4, 4) of T_WC, and their covariances (N, 6, 6) then, on the right tangent."""
        moved = pose(self.r_lw, np.zeros(3)) @ poses
        out = [c + self.of_pose(t_lc) for t_lc, c in zip(moved, covariances, strict=True)]
        return moved, np.asarray(out).reshape(-1, 6, 6)

    def points(self, points: Array, covariances: Array) -> tuple[Array, Array]:
        """Points (N, 3) of W in the level world, and their covariances (N, 3, 3) there."""
        turn = self.r_lw
        moved = points @ turn.T
        out = [turn @ c @ turn.T + self.of_point(p) for p, c in zip(moved, covariances, strict=True)]
        return moved, np.asarray(out).reshape(-1, 3, 3)

    def of_pose(self, t_lc: Array) -> Array:
        """(6, 6) what is not known of the level in a pose in the level world, right tangent."""
        back = t_lc[:3, :3].T
        by_level = np.concatenate([-back @ skew(t_lc[:3, 3]), back]) @ _SIDE
        return np.asarray(by_level @ self.covariance @ by_level.T)

    def of_point(self, point: Array) -> Array:
        """(3, 3) the same of a point (3,) there."""
        by_level = -skew(point) @ _SIDE
        return np.asarray(by_level @ self.covariance @ by_level.T)

    def numbers(self) -> dict[str, Any]:
        """For ``summary.json``: up in W, roll and pitch of its camera, degrees, their standard deviation."""
        x, y, z = self.up.tolist()
        return {
            "up": [x, y, z],
            "roll_deg": float(np.rad2deg(np.arctan2(-x, -y))),
            "pitch_deg": float(np.rad2deg(np.arctan2(-z, np.hypot(x, y)))),
            "sd_deg": float(np.rad2deg(np.sqrt(np.trace(self.covariance) / 2.0))),
            "source": self.source,
        }

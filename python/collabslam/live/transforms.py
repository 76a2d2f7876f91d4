"""T_CF from ROS's tf: images of Cf that wait for their pose."""

from __future__ import annotations

from collections import deque

import numpy as np

from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.errors import SettingsError
from collabslam.live.pairing import WAITING
from collabslam.types import Array


class WaitingStamps:
    """Instants of Cf whose pose tf will tell.

    Parameters
    ----------
    sd : tuple of float
        Standard deviations of T_CF as tf has it: of each coordinate (metres), and about each axis (degrees).
        tf tells none.
    tree : TransformTree
        What tf has told; several may wait for one tree.

    Raises
    ------
    SettingsError
        If they are not positive.
    """

    def __init__(self, sd: tuple[float, float], tree: TransformTree) -> None:
        if not all(0.0 < s < np.inf for s in sd):
            raise SettingsError(f"The standard deviations of T_CF are {sd}; give metres and degrees above 0.")
        self._tree = tree
        self._covariance = np.diag([sd[0] ** 2] * 3 + [np.deg2rad(sd[1]) ** 2] * 3)
        self._waiting: deque[tuple[float, str]] = deque(maxlen=WAITING)

    def add(self, stamp: float, frame: str) -> None:
        """An image was taken at ``stamp`` by the camera of that frame."""
        self._waiting.append((stamp, frame))

    def known(self, robot_frame: str) -> list[tuple[float, Array, Array]]:
        """Stamp, T_CF (4, 4) and covariance (6, 6) of each instant that tf tells by now; the others wait."""
        found = []
        for stamp, frame in list(self._waiting):
            t_cf = self._tree.between(robot_frame, frame, stamp)
            if t_cf is not None:
                found.append((stamp, t_cf, self._covariance))
                self._waiting.remove((stamp, frame))
        return found

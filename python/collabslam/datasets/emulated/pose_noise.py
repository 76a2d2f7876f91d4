"""How well a worn camera's pose is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collabslam.errors import SettingsError
from collabslam.types import Array


@dataclass(frozen=True)
class PoseNoise:
    """Standard deviations of a measured ``T_CF``.

    Attributes
    ----------
    position : float
        Metres, of each coordinate in F.
    roll, pitch, yaw : float
        Degrees about F's z, x and y axis.
    """

    position: float = 0.03
    roll: float = 0.5
    pitch: float = 0.5
    yaw: float = 1.0

    def __post_init__(self) -> None:
        values = (self.position, self.roll, self.pitch, self.yaw)
        if not all(np.isfinite(v) and v >= 0.0 for v in values):
            raise SettingsError(
                f"The noise {values} is not allowed; give metres and degrees that are zero or more."
            )

    @property
    def deviations(self) -> Array:
        """(6,) standard deviations over (translation, rotation), metres and radians."""
        angles = np.deg2rad([self.pitch, self.yaw, self.roll])
        return np.concatenate([np.full(3, self.position), angles])

    @property
    def covariance(self) -> Array:
        """(6, 6) over (translation, rotation), m^2 and rad^2."""
        return np.diag(self.deviations**2)


SENSOR_NOISE = PoseNoise()
RIG_NOISE = PoseNoise(0.002, 0.05, 0.05, 0.05)

"""What shakes a camera beside its walk or drive, as uneven ground or a hand does."""

from __future__ import annotations

import numpy as np

from collabslam.types import Array

SHAKE_HZ = (0.2, 1.5)
"""Frequencies of the shake, from and to."""

_SINES = 8


class Tremor:
    """A sum of sines along and about each axis.

    Parameters
    ----------
    generator : Generator
        Draws frequencies and amplitudes.
    degrees, metres : float
        Standard deviation about each axis, and along each.
    """

    def __init__(self, generator: np.random.Generator, degrees: float, metres: float) -> None:
        low, high = np.log(SHAKE_HZ)
        self._rates = np.exp(generator.uniform(low, high, _SINES))
        sd = np.repeat([metres, np.deg2rad(degrees)], 3)[:, None] / np.sqrt(_SINES)
        self._sines = sd * generator.standard_normal((6, _SINES))
        self._cosines = sd * generator.standard_normal((6, _SINES))

    def at(self, t: float) -> Array:
        """(6,): metres along x, y and z, then radians of yaw, pitch and roll, at `t` seconds."""
        angle = 2.0 * np.pi * self._rates * t
        return np.asarray(self._sines @ np.sin(angle) + self._cosines @ np.cos(angle))

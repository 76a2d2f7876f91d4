"""The brightness of a camera's pictures, as its own exposure control makes it."""

from __future__ import annotations

import numpy as np

from collabslam.simulation.trajectory import waves

JUMP_SECONDS = (2.0, 5.0)
"""From one step of the exposure to the next, at least and at most."""


class ExposureControl:
    """It wanders slowly and, if told, is off by a step now and then.

    Parameters
    ----------
    seed, camera : int
        Draw when; each camera has its own.
    seconds : float
        For which it is asked.
    light : float
        Brightness about which it wanders; 1 is that of the textures.
    step : float
        Of the exposure, stops; 0 for none.
    """

    def __init__(
        self, seed: int, camera: int, seconds: float, *, light: float = 1.0, step: float = 0.0
    ) -> None:
        self._phases = _generator(seed, 20 + camera).uniform(0.0, 6.28, 2).tolist()
        self._light, self._step = light, step
        count = int(seconds / JUMP_SECONDS[0]) + 1
        drawn = _generator(seed, 24 + camera)
        self._jumps = np.cumsum(drawn.uniform(*JUMP_SECONDS, count))
        self._steps = np.cumsum(drawn.integers(1, 3, count + 1)) % 3 - 1

    def at(self, t: float) -> float:
        """Brightness of the picture at `t` seconds."""
        a, b = self._phases
        wandering = 1.0 + waves(t, [(0.07, 0.13, a), (0.04, 0.41, b)])
        steps = int(self._steps[np.searchsorted(self._jumps, t)])
        return float(self._light * wandering * 2.0 ** (self._step * steps))


def _generator(seed: int, part: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64((seed, part)))

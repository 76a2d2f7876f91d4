"""People who come the other way and walk past robot and person."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from collabslam.types import Array
from collabslam_lab.worlds.motion import Drive
from collabslam_lab.worn_sensors import Build, Walker

ASIDE = 0.95
"""Metres between their way and the middle of the corridor."""
REACH = 14.0
"""Metres before and behind the robot within which they are there."""

_SPEED = (0.9, 1.5)
_DT = 0.02


@dataclass(frozen=True)
class Passer:
    """Somebody who walks past.

    Attributes
    ----------
    drive : Drive
        Of the robot whose way it is.
    meets : float
        When they are beside the robot, seconds.
    left : float
        Metres between their way and the middle, to the left of the robot's direction.
    seed : int
        Of speed and gait.
    """

    drive: Drive
    meets: float
    left: float
    seed: int

    def there(self, t: float) -> bool:
        """Whether they are near."""
        return abs(self._place(t) - self.drive.progress(t)) < REACH

    def trunk(self, t: float) -> Array:
        """(2,) x, y at time t, metres."""
        return self._walker.trunk(t)

    def heading(self, t: float) -> float:
        """Where they walk to, radians."""
        return float(self.drive.route.along(self._place(t))[1]) + np.pi

    def legs(self, t: float) -> Array:
        """(2, 3): x, y and radius of both shins, metres."""
        return self._walker.legs(t)

    def _place(self, t: float) -> float:
        """Arc length along the way."""
        return self.drive.progress(self.meets) - self._speed * (t - self.meets)

    @cached_property
    def _speed(self) -> float:
        return float(np.random.Generator(np.random.PCG64((self.seed, 6))).uniform(*_SPEED))

    @cached_property
    def _walker(self) -> Walker:
        span = REACH / self._speed + 1.0
        moments = np.arange(self.meets - span, self.meets + span, _DT)
        path, _ = self.drive.route.along([self._place(float(t)) for t in moments], self.left)
        return Walker(moments, path, build=Build.drawn(np.random.Generator(np.random.PCG64((self.seed, 7)))))


def passers(drive: Drive, per_minute: float, left: float, seed: int) -> list[Passer]:
    """Those who are met, about `per_minute`, at random times but not while the robot still stands."""
    rng = np.random.Generator(np.random.PCG64((seed, 8)))
    out: list[Passer] = []
    t = 2.0
    while per_minute > 0.0:
        t += 60.0 / per_minute * float(rng.uniform(0.5, 1.5))
        if t >= drive.duration:
            break
        out.append(Passer(drive, t, left, int(rng.integers(2**31))))
    return out

"""How hard a rendered corridor is to see and to drive: as a plain picture, or as recordings are."""

from __future__ import annotations

from dataclasses import dataclass, field

from collabslam.simulation.rendered import Sensor


@dataclass(frozen=True)
class Conditions:
    """What a camera and a corridor have beside their geometry; the defaults are a plain, easy world.

    Attributes
    ----------
    exposure : float
        Of each row, seconds: 0 for pictures without blur.
    readout : float
        Seconds from the first row's exposure to the last row's.
    sensor : Sensor
        Noise of the pictures.
    exposure_step : float
        By which the exposure is off now and then, stops; 0 where it is held.
    shake : (float, float)
        Of the robot's camera beside its driving: standard deviation about each axis, degrees, and along
        each, metres.
    bare : float
        Share of the stretches of wall that carry nothing.
    contrast : float
        Of walls, floor and ceiling: share of the textures' differences of brightness that is left.
    alike : float
        How much one tile of floor or ceiling is like the other: 0 each its own, 1 all the same.
    furniture : float
        Share of the furniture that is there.
    """

    exposure: float = 0.0
    readout: float = 0.0
    sensor: Sensor = field(default_factory=Sensor)
    exposure_step: float = 0.0
    shake: tuple[float, float] = (0.0, 0.0)
    bare: float = 0.0
    contrast: float = 1.0
    alike: float = 0.0
    furniture: float = 1.0


PLAIN = Conditions()
"""Easy to see: what a fault of the program is looked for in."""
HARD = Conditions(
    exposure=0.015,
    readout=0.018,
    sensor=Sensor(electrons=2200.0),
    exposure_step=0.37,
    shake=(0.3, 0.0067),
    bare=0.53,
    contrast=0.53,
    alike=0.69,
    furniture=0.2,
)
"""As recordings are: the middle of what the lab's worlds as hard as life draw from, whose ranges were set by
what the tracker makes of recordings."""

"""Worlds as hard as life: what recordings have and a plain world has not, and longer ways.

How hard is drawn for each world by its own seed, within `RANGES`, so that worlds differ as recordings do.
The ranges were set by what the tracker makes of both (``collabslam-lab reproduce worlds``: features, track
lengths, refusals, innovations and their correlation in time), before any mode was compared with another in
them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collabslam.errors import InputError
from collabslam.simulation.rendered import Sensor
from collabslam_lab.worlds.catalogue import SETS, WITH_BOARD, Recipe, with_board

LIFE = "-life"
"""What follows a recipe's name for the world under the conditions of life."""

RANGES: dict[str, tuple[float, float]] = {
    "exposure": (0.008, 0.03),
    "readout": (0.01, 0.033),
    "electrons": (800.0, 6000.0),
    "exposure_step": (0.2, 0.7),
    "shake_degrees": (0.15, 0.6),
    "shake_metres": (0.003, 0.015),
    "passers": (4.0, 16.0),
    "bare": (0.4, 0.7),
    "contrast": (0.4, 0.7),
    "alike": (0.5, 0.95),
    "furniture": (0.1, 0.4),
}
"""From and to; each is drawn evenly in its logarithm. Units are those of `Recipe`, `Sensor` and `Style`."""

WAYS: dict[str, str] = {
    "corridor": "S20",
    "a": "S9 L S10",
    "b": "S10 R S6 R S4",
    "c": "S6 L S3 R S8 L S5",
    "d": "S12 R S8 R S5",
    "e": "S7 R S5 R S6 L S9",
    "f": "S8 L S6 R S9 L S7",
    "g": "S9 L S8 L S9 R S10",
    "h": "S14 L S12 L S14",
    "i": "S10 L S12 L S8 L S9 R S6",
    "j": "S10 R S8 L S12 R S10 R S9 L S12 R S11",
}
"""Ways of 50 to 200 m, by the name of a recipe or of its set; turns and the study's corridors stay."""
CORRIDOR_METRES = 50.0
WALKING_PACE = 1.2
"""m/s, on ways that are not corridors."""


def lifelike(recipe: Recipe) -> Recipe:
    """A recipe under the conditions of life, and on its longer way if there is one."""
    rng = np.random.Generator(np.random.PCG64((recipe.seed, 9)))
    drawn = {key: float(np.exp(rng.uniform(*np.log(ends)))) for key, ends in RANGES.items()}
    out = replace(
        recipe,
        name=recipe.name + LIFE,
        exposure=drawn["exposure"],
        readout=drawn["readout"],
        sensor=Sensor(electrons=drawn["electrons"]),
        exposure_step=drawn["exposure_step"],
        shake=(drawn["shake_degrees"], drawn["shake_metres"]),
        passers=drawn["passers"],
        style=replace(
            recipe.style,
            bare=drawn["bare"],
            contrast=drawn["contrast"],
            alike=drawn["alike"],
            furniture=drawn["furniture"],
        ),
    )
    if recipe.name in WAYS:
        return replace(out, route=WAYS[recipe.name], speed=WALKING_PACE)
    if recipe.name.startswith("corridor-"):
        return replace(out, route=WAYS["corridor"], length=CORRIDOR_METRES)
    return out


def recipe(name: str) -> Recipe:
    """The recipe of a name: one of `SETS`, ``NAME-life`` (`lifelike`), or ``NAME-board`` (`with_board`).

    Raises
    ------
    InputError
        If there is none.
    """
    for suffix, change in ((WITH_BOARD, with_board), (LIFE, lifelike)):
        if name.endswith(suffix):
            return change(recipe(name.removesuffix(suffix)))
    known = {r.name: r for rows in SETS.values() for r in rows}
    if name not in known:
        raise InputError(f"There is no world '{name}'; there are {', '.join(known)}.")
    return known[name]

"""A gyroscope beside the recording that says what is not so: in files, and of how it sits."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from collabslam.geometry import rotation_log
from collabslam.simulation.trajectory import CorridorWalk
from collabslam_lab.reliability.attacks.attack import (
    HELD,
    HELD_OR_TOLD,
    REFUSED,
    Attack,
    AttackOutcome,
    Deed,
)
from collabslam_lab.reliability.attacks.scene import Scene

RATE, SECONDS, SPEED = 200, 11.0, 1.5
BIAS = np.array([0.01, -0.008, 0.012])
Table = NDArray[np.float64]
Change = Callable[[Table], Table]


@lru_cache(maxsize=1)
def samples() -> Table:
    """Stamps and rates, (N, 4), along the axes of Cs on the attacks' walk, with a bias and noise."""
    walk, half = CorridorWalk(SPEED), 0.5 / RATE
    times = np.arange(0.0, SECONDS, 1.0 / RATE) + half
    turns = [walk.robot(t - half)[:3, :3].T @ walk.robot(t + half)[:3, :3] for t in times.tolist()]
    noise = 1e-3 * np.sqrt(RATE) * np.random.Generator(np.random.PCG64(19)).standard_normal((len(times), 3))
    return np.column_stack([times, np.array([rotation_log(turn) * RATE for turn in turns]) + BIAS + noise])


def _times(factor: float) -> Change:
    return lambda table: np.column_stack([table[:, :1], factor * table[:, 1:]])


def _order(*columns: int) -> Change:
    return lambda table: table[:, [0, *columns]]


def _shifted(seconds: float) -> Change:
    return lambda table: table + np.array([seconds, 0.0, 0.0, 0.0])


def _set_back(table: Table) -> Table:
    out: Table = table.copy()
    out[1000:, 0] -= 3.0
    return out


def _stuck(first: int, last: int) -> Change:
    def change(table: Table) -> Table:
        out: Table = table.copy()
        out[first:last, 1:] = out[first, 1:]
        return out

    return change


def _without(first: int, last: int) -> Change:
    return lambda table: np.concatenate([table[:first], table[last:]])


def _with_nan(table: Table) -> Table:
    out: Table = table.copy()
    out[::17, 2] = np.nan
    return out


def _spikes(table: Table) -> Table:
    out: Table = table.copy()
    out[::101, 1:] = 1e4
    return out


def _drifting(table: Table) -> Table:
    out: Table = table.copy()
    out[:, 1:] += 0.03 * table[:, :1]
    return out


ROWS: tuple[tuple[str, str, Change, tuple[AttackOutcome, ...]], ...] = (
    ("as-it-is", "as it is", lambda table: table, HELD),
    ("counts", "rates in counts of a sensor", _times(1000.0), REFUSED),
    ("exchanged", "x and z of the rates exchanged", _order(3, 2, 1), HELD_OR_TOLD),
    ("sign", "rates with the other sign", _times(-1.0), HELD_OR_TOLD),
    ("double", "rates twice as large", _times(2.0), HELD_OR_TOLD),
    ("late", "stamps 0.3 s late", _shifted(0.3), HELD_OR_TOLD),
    ("set-back", "a clock that is set back by 3 s", _set_back, REFUSED),
    ("other-day", "stamps of another day", _shifted(1e6), REFUSED),
    ("stuck", "one sample for a second and a half", _stuck(800, 1100), HELD_OR_TOLD),
    ("frozen", "one sample from 2 s on", _stuck(400, 10**6), REFUSED),
    ("gap", "two seconds without a sample", _without(800, 1200), HELD_OR_TOLD),
    ("nan", "one sample in 17 not a number", _with_nan, HELD_OR_TOLD),
    ("spikes", "one sample in 101 of 10 000 rad/s", _spikes, HELD_OR_TOLD),
    ("drifting", "a bias that grows by 0.03 rad/s in each second", _drifting, HELD_OR_TOLD),
    ("slow", "one sample a second", lambda table: table[::RATE], REFUSED),
)


def _turning(table: Table) -> Table:
    out: Table = table.copy()
    out[:, 1:] += np.array([1.5, -2.0, 1.0])
    return out


WORN_ROWS: tuple[tuple[str, str, Change, tuple[AttackOutcome, ...]], ...] = (
    ("worn-counts", "rates in counts of a sensor", _times(1000.0), REFUSED),
    ("worn-turning", "2.7 rad/s that are not there", _turning, HELD_OR_TOLD),
    ("worn-degrees", "degrees for radians", _times(57.3), HELD_OR_TOLD),
    ("worn-nan", "one sample in 17 not a number", _with_nan, HELD_OR_TOLD),
    ("worn-frozen", "one sample from 2 s on", _stuck(400, 10**6), REFUSED),
)


def _told(row: tuple[str, str, Change, tuple[AttackOutcome, ...]]) -> Attack:
    name, what, change, good = row

    def make(scene: Scene) -> Deed:
        path = scene.folder / "gyro.csv"
        np.savetxt(path, change(samples()), delimiter=",", fmt="%.9f")
        return scene.run("--gyro", path, source=scene.ground.walk)

    return Attack("gyroscope", name, f"a gyroscope: {what}", make, good)


def _told_of_cf(row: tuple[str, str, Change, tuple[AttackOutcome, ...]]) -> Attack:
    name, what, change, good = row

    def make(scene: Scene) -> Deed:
        path = scene.folder / "gyro.csv"
        np.savetxt(path, change(samples()), delimiter=",", fmt="%.9f")
        options = ("--set", "filter.worn.readout=0.02", "--set", "filter.worn.readout_sd=0.002")
        return scene.run("--worn-gyro", path, *options, source=scene.ground.walk)

    return Attack("gyroscope", name, f"a gyroscope of Cf: {what}", make, good)


ATTACKS = (*map(_told, ROWS), *map(_told_of_cf, WORN_ROWS))

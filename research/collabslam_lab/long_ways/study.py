"""Rounds in corridors, some with walls that repeat: one file of numbers, and plan views with the loops."""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.formats.files import write_bytes, write_text
from collabslam.runs.results import jsonable
from collabslam_lab.long_ways.drawing import plan_view
from collabslam_lab.long_ways.walk import Walked, walk
from collabslam_lab.worlds.building import Style
from collabslam_lab.worlds.catalogue import Recipe

EXPERIMENTS = {"loops": "long ways round and round through corridors: loops.json, and plan views"}
_LAP = "S2 L S2 L S2 L S2 L"
_QUICK_FRAMES = 400


def recipes(*, quick: bool) -> list[Recipe]:
    """Ways of one round and a part of the next, and of many; every second one between walls that repeat."""
    laps = 2 if quick else 34
    ring = Recipe("ring", " ".join([_LAP] * laps), 700, along=0.5)
    repeated = replace(ring, name="ring-repeated", seed=701, style=Style("repeated"))
    return [ring, repeated]


def study_loops(folder: Path, *, seed: int, jobs: int, runs: int, quick: bool) -> dict[str, Any]:
    """Goes all ways, writes ``loops.json`` and the pictures, prints the numbers.

    Parameters
    ----------
    folder : Path
    seed : int
        Of the first draw of the noise.
    jobs : int
        Processes at a time.
    runs : int
        Draws of the noise; one if ``quick``.
    quick : bool
        One round and a half of each way.
    """
    frames = _QUICK_FRAMES if quick else None
    seeds = [seed] if quick else list(range(seed, seed + runs))
    ways = [(recipe, s) for s in seeds for recipe in recipes(quick=quick)]
    with ProcessPoolExecutor(jobs) as pool:
        walked = list(pool.map(walk, *zip(*ways, strict=True), [frames] * len(ways)))
    numbers = summary(walked)
    write_text(folder / "loops.json", json.dumps(jsonable(numbers), indent=2, sort_keys=True) + "\n")
    for one in walked[:2]:
        write_bytes(folder / f"{one.name}.png", plan_view(one))
    for name, value in numbers.items():
        print(f"{name:42} {value if isinstance(value, int) else format(value, '.3f')}")
    return numbers


def summary(walked: Sequence[Walked]) -> dict[str, Any]:
    """The numbers of ``loops.json``; means over the ways that have a loop, NaN if none has."""
    closed = [one for one in walked if one.first_loop is not None]

    def mean(values: Sequence[float]) -> float:
        return float(np.mean(values)) if values else float("nan")

    after = [one.odometry[one.first_loop :].mean() / one.corrected[one.first_loop :].mean() for one in closed]
    return {
        "frames": max(len(one.ms) for one in walked),
        "loops": sum(one.loops for one in walked),
        "ms_median_ratio_last_over_second_tenth": mean([_ratio(one, 50.0) for one in walked]),
        "ms_p99_ratio_last_over_second_tenth": mean([_ratio(one, 99.0) for one in walked]),
        "error_before_over_after": mean(after),
        "nees_mid": mean([one.nees_mid for one in closed]),
        "nees_end": mean([one.nees_end for one in closed]),
        "nees_between": mean([one.nees_between for one in closed]),
        "false_loops": sum(one.false for one in walked),
        "map_load_s": max(one.load_s for one in walked),
    }


def _ratio(one: Walked, percent: float) -> float:
    """Time of a frame in the last tenth over that in the second."""
    tenth = max(1, len(one.ms) // 10)
    last, second = one.ms[-tenth:], one.ms[tenth : 2 * tenth]
    return float(np.percentile(last, percent) / np.percentile(second, percent))

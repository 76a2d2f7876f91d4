"""Rounds in corridors, some with walls that repeat: one file of numbers, and plan views with the loops."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from collabslam.batch.engines import LOCAL, Engine
from collabslam.formats.files import write_bytes, write_text
from collabslam.runs.results import jsonable
from collabslam_lab.long_trajectories.drawing import plan_view
from collabslam_lab.long_trajectories.keeping import Trajectory, go
from collabslam_lab.long_trajectories.walk import Walked
from collabslam_lab.report import markdown_table
from collabslam_lab.worlds.building import Style
from collabslam_lab.worlds.catalogue import Recipe

EXPERIMENTS = {"loops": "long trajectories round and round through corridors: loops.json, and plan views"}
_LAP = "S2 L S2 L S2 L S2 L"
_LAPS, _FRAMES = 34, 420
_REPEATED, _QUICK_REPEATED = 100, 1
_DRAWS = range(50)


def trajectories(seeds: Sequence[int] | None, *, quick: bool) -> list[Trajectory]:
    """A long one, draws of a round and some of the next, and such rounds in buildings whose walls repeat."""
    ring = Recipe("ring", _laps(2), 700, along=0.5)
    drawn = seeds or ((0,) if quick else _DRAWS)
    closed = [Trajectory(ring, seed, _FRAMES) for seed in drawn]
    if not quick:
        closed.insert(0, Trajectory(replace(ring, route=_laps(_LAPS)), 0, None))
    style = Style("repeated")
    alike = [
        Trajectory(replace(ring, name=f"ring-repeated-{k}", seed=701 + k, style=style), 0, _FRAMES)
        for k in range(_QUICK_REPEATED if quick else _REPEATED)
    ]
    return closed + alike


def _laps(count: int) -> str:
    return " ".join([_LAP] * count)


def study_loops(
    folder: Path, *, seeds: Sequence[int] | None, jobs: int, quick: bool, engine: Engine = LOCAL
) -> dict[str, Any]:
    """Runs all trajectories, writes ``loops.json``, ``loops.md`` and two pictures, prints the table.

    Parameters
    ----------
    folder : Path
    seeds : sequence of int or None
        Of the draws of the noise; None for 50 of them, one if ``quick``.
    jobs : int
        Processes at a time.
    quick : bool
        One draw, one building whose walls repeat, and no long trajectory.
    engine : Engine
        What runs the processes.
    """
    walked = go(trajectories(seeds, quick=quick), folder / "trajectories", jobs=jobs, engine=engine)
    numbers = summary(walked)
    write_text(folder / "loops.json", json.dumps(jsonable(numbers), indent=2, sort_keys=True) + "\n")
    for one in (walked[0], walked[-1]):
        write_bytes(folder / f"{one.name}.png", plan_view(one))
    rows = [(name, str(v) if isinstance(v, int) else format(v, ".3f")) for name, v in numbers.items()]
    text = markdown_table(("figure", "value"), rows)
    write_text(folder / "loops.md", text + "\n")
    print(text)
    return numbers


def summary(walked: Sequence[Walked]) -> dict[str, Any]:
    """The numbers of ``loops.json``.

    Times and saving are of the longest, means of the draws of `ring` that have a loop (NaN if none has),
    false loops of all.
    """
    longest = max(walked, key=lambda one: len(one.ms))
    closed = [one for one in walked if one.first_loop is not None and one.name == "ring"]

    def mean(values: Sequence[float]) -> float:
        return float(np.mean(values)) if values else float("nan")

    after = [one.odometry[one.first_loop :].mean() / one.corrected[one.first_loop :].mean() for one in closed]
    return {
        "trajectories": len(walked),
        "frames": len(longest.ms),
        "loops": sum(one.loops for one in walked),
        "ms_median_ratio_last_over_second_tenth": _ratio(longest, 50.0),
        "ms_p99_ratio_last_over_second_tenth": _ratio(longest, 99.0),
        "ms_p99": float(np.percentile(longest.ms, 99.0)),
        "ms_max": float(longest.ms.max()),
        "error_before_over_after": mean(after),
        "error_before_over_after_least": min(after, default=float("nan")),
        "nees_mid": mean([one.nees_mid for one in closed]),
        "nees_end": mean([one.nees_end for one in closed]),
        "nees_between": mean([one.nees_between for one in closed]),
        "false_loops": sum(one.false for one in walked),
        "submaps": len(longest.submaps),
        "bytes_a_submap": longest.saved_bytes / max(1, len(longest.submaps)),
        "map_save_s": longest.save_s,
        "map_load_s": longest.load_s,
    }


def _ratio(one: Walked, percent: float) -> float:
    """Time of a frame in the last tenth over that in the second."""
    tenth = max(1, len(one.ms) // 10)
    last, second = one.ms[-tenth:], one.ms[tenth : 2 * tenth]
    return float(np.percentile(last, percent) / np.percentile(second, percent))

"""What is told of a recording and mode: medians over the runs, and how much Cf brings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from collabslam.runs.report import median_of
from collabslam_lab.benchmark.plan import Plan
from collabslam_lab.benchmark.store import Row
from collabslam_lab.intervals import t_interval

NAMES = (
    "ate_pct_all_frames",
    "coverage",
    "ok_share",
    "false_ok_share",
    "nees_position",
    "nees_attitude",
    "sharpness_position",
    "sharpness_attitude",
    "ms_p99",
    "ms_max",
)
"""The numbers of `collabslam.runs.summary` by which recordings and modes are judged."""
BASE = "mono"


@dataclass(frozen=True)
class Difference:
    """How much lower the error over all frames is with Cf, in percent of the path.

    Attributes
    ----------
    recording, mode : str
    pairs : int
        Seeds that both modes were run with.
    mean : float
        Of mode minus `BASE`: negative if Cf helps.
    low, high : float or None
        Ends of the 95 % interval of that mean (Student's t over the seeds); None for a single pair.
    """

    recording: str
    mode: str
    pairs: int
    mean: float
    low: float | None
    high: float | None


def split(rows: Iterable[Row]) -> tuple[list[Row], list[Row]]:
    """The rows with one error of ``T_CF`` for each block of overlap (or none drawn), and the others."""
    apart: tuple[list[Row], list[Row]] = ([], [])
    for row in rows:
        apart[bool(row["independent"])].append(row)
    return apart


def medians(plan: Plan, rows: Sequence[Row]) -> dict[str, dict[str, dict[str, Any]]]:
    """Medians of `NAMES` over the runs of each recording and mode, with the number of ``runs``.

    A run that failed counts as one without a pose in any frame.
    """
    out: dict[str, dict[str, dict[str, Any]]] = {}
    for entry in plan.recordings:
        for mode in entry.modes:
            runs = [r for r in rows if r["recording"] == entry.name and r["mode"] == mode]
            if not runs:
                continue
            done = [r if r["status"] == "done" else {"coverage": 0.0, "ok_share": 0.0} for r in runs]
            told = {name: median_of(done, name) for name in NAMES}
            out.setdefault(entry.name, {})[mode] = {**told, "runs": len(runs)}
    return out


def differences(plan: Plan, rows: Sequence[Row]) -> list[Difference]:
    """Every mode against `BASE` on the same recording, seed by seed."""
    out = []
    for entry in plan.recordings:
        base = _errors(rows, entry.name, BASE)
        for mode in entry.modes:
            mine = _errors(rows, entry.name, mode)
            found = [mine[seed] - base[seed] for seed in mine if seed in base]
            if mode != BASE and found:
                out.append(Difference(entry.name, mode, len(found), *t_interval(found)))
    return out


def _errors(rows: Sequence[Row], name: str, mode: str) -> Mapping[int, float]:
    runs = [r for r in rows if r["recording"] == name and r["mode"] == mode and r["status"] == "done"]
    return {r["seed"]: r["ate_pct_all_frames"] for r in runs if r["ate_pct_all_frames"] is not None}

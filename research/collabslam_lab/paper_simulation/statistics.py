"""The numbers of the tables, from outcomes of many runs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from collabslam.evaluation.consistency import nees_band
from collabslam.types import Array
from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings
from collabslam_lab.paper_simulation.wall_run import RunOutcome

PAPER_RUNS = 20


def final_error(outcome: RunOutcome) -> float:
    """Mean error at the end over the runs that did not diverge, metres."""
    return _mean(outcome.error[:, -1])


def average_error(outcome: RunOutcome) -> float:
    """Mean over time and over the runs that did not diverge, metres."""
    return _mean(outcome.error[np.isfinite(outcome.error[:, -1])])


def mean_nees(outcome: RunOutcome) -> float:
    """NEES of the position (2 expected), averaged over time and runs."""
    return _mean(outcome.nees)


def median_run_nees(outcome: RunOutcome) -> float:
    """The same of the median run, which a few lost runs do not move."""
    means = [_mean(run) for run in outcome.nees]
    good = [m for m in means if math.isfinite(m)]
    return float(np.median(good)) if good else math.nan


def drift_at_window_ends(s: SimulationSettings, outcome: RunOutcome) -> list[float]:
    """Mean s of Eq. 14 in the last frame of each window."""
    return [_mean(outcome.scale_drift[:, _last_frame(s, end)]) for _, end in s.windows]


def drift_before_windows(s: SimulationSettings, outcome: RunOutcome) -> list[float]:
    """Mean s in the last frame before each window."""
    return [_mean(outcome.scale_drift[:, _last_frame(s, start)]) for start, _ in s.windows]


def compare(s: SimulationSettings, mono: RunOutcome, collab: RunOutcome) -> dict[str, Any]:
    """One estimator without and with pseudo-stereo, run by run the same truth and bearings."""
    alive = np.isfinite(mono.error[:, -1]) & np.isfinite(collab.error[:, -1])
    better = collab.error[alive, -1] < mono.error[alive, -1]
    runs = len(mono.error)
    return {
        "runs": runs,
        "diverged_mono": runs - int(np.isfinite(mono.error[:, -1]).sum()),
        "diverged_collab": runs - int(np.isfinite(collab.error[:, -1]).sum()),
        "mono_final_m": final_error(mono),
        "collab_final_m": final_error(collab),
        "mono_average_m": average_error(mono),
        "collab_average_m": average_error(collab),
        "final_ratio": final_error(collab) / final_error(mono),
        "average_ratio": average_error(collab) / average_error(mono),
        "final_ratio_of_20_runs": ratio_of_blocks(mono, collab),
        "better_share": float(better.mean()) if alive.any() else math.nan,
        "scale_drift_before_windows": drift_before_windows(s, collab),
        "scale_drift_window_ends": drift_at_window_ends(s, collab),
        "nees_mono": mean_nees(mono),
        "nees_collab": mean_nees(collab),
        "nees_mono_median_run": median_run_nees(mono),
        "nees_collab_median_run": median_run_nees(collab),
        "nees_expected": 2.0,
        "nees_band": list(nees_band(2, runs)),
    }


def ratio_of_blocks(mono: RunOutcome, collab: RunOutcome) -> list[float]:
    """Least and largest ratio of final errors that blocks of 20 of these runs give."""
    count = len(mono.error) // PAPER_RUNS
    if count < 2:
        return []
    ends = [o.error[: count * PAPER_RUNS, -1].reshape(count, PAPER_RUNS).mean(axis=1) for o in (collab, mono)]
    ratio = ends[0] / ends[1]
    return [float(np.nanmin(ratio)), float(np.nanmax(ratio))] if np.isfinite(ratio).any() else []


def mean_over_runs(values: Array) -> Array:
    """(T,) mean of (B, T) over the runs that have a value; NaN where none has."""
    count = np.isfinite(values).sum(axis=0)
    total = np.where(np.isfinite(values), values, 0.0).sum(axis=0)
    out: Array = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return out


def _last_frame(s: SimulationSettings, end: float) -> int:
    """Index of the last frame before a time, seconds."""
    frame = math.ceil(end * float(s.rate) - 1e-6) - 1
    return min(max(frame, 0), s.frames - 1)


def _mean(values: Array) -> float:
    good = values[np.isfinite(values)]
    return float(good.mean()) if good.size else math.nan

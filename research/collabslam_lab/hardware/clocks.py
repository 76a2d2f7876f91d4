"""What a clock of Cf's own costs: views between frames, at other rates, or late."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from collabslam import run
from collabslam.datasets.wrapped import FirstFrames
from collabslam.evaluation.consistency import nees, pose_tangent_error
from collabslam.runs.runner import RunResult
from collabslam.simulation import corridor_recording
from collabslam.simulation.held import HeldRecording
from collabslam.simulation.recording import SimulatedRecording
from collabslam.types import Array
from collabslam_lab.hardware.free_running import FreeRunning, WornAt, WornClock
from collabslam_lab.hardware.wrong_stamps import AHEAD

Row = dict[str, Any]

TOGETHER = WornClock(10.0)
"""Every view is of a frame's instant, and there at once."""
RATES, PHASES, LATE = (7.0, 10.0, 30.0), (0.0, 0.05), (0.0, 0.3, 0.95)
"""Views per second, when the first one is taken and how late each comes, seconds."""
CLOCKS = tuple(WornClock(rate, phase, late) for late in LATE for rate in RATES for phase in PHASES)
FEW_CLOCKS = (WornClock(10.0, 0.05), WornClock(7.0, 0.05, 0.95), WornClock(30.0, 0.05, 0.3))
WAY_M = 9.0
SETTLED = 1.5
"""Seconds from the first frame on from which errors count: by then every clock's first view has come."""


def clock_rows(seeds: Sequence[int], clocks: Sequence[WornClock], frames: int | None = None) -> Iterator[Row]:
    """One row for each seed and clock: the straight corridor with a person who looks ahead all the time.

    Parameters
    ----------
    seeds : sequence of int
        Of the noise of the pictures and of T_CF.
    clocks : sequence of WornClock
        Compared with `TOGETHER`, which comes first.
    frames : int, optional
        Only so many from the first one on.
    """
    for seed in seeds:
        world = corridor_recording(seed, length_m=WAY_M, glances=AHEAD)
        held = HeldRecording(world if frames is None else FirstFrames(world, frames))
        worn = _worn_of(world)
        for clock in dict.fromkeys((TOGETHER, *clocks)):
            result = run(FreeRunning(held, worn, clock))
            yield {
                "seed": seed,
                "rate_hz": clock.rate,
                "phase_s": clock.phase,
                "late_s": clock.late,
                **scores_of(result),
            }


def _worn_of(world: SimulatedRecording) -> WornAt:
    """What Cf sees at a time, whatever the clock.

    The noise of a view and of its T_CF is that of the nearest frame's instant, so that clocks are compared
    without the luck of the draw, which is larger than what they cost.
    """
    taken = cache(lambda tick: world.worn_at(1e-4 * tick, round(1e-4 * tick * TOGETHER.rate)))
    return lambda t, _: taken(round(1e4 * t))


def scores_of(result: RunResult) -> Row:
    """Sums over the frames that count, for `pooled`, and which share of all frames is OK and DEGRADED."""
    record, truth = result.record, result.truth
    sums = dict.fromkeys(("sum_square_m2", "sum_variance_m2", "sum_nees"), 0.0)
    shares = {
        "ok_share": result.summary["ok_share"],
        "degraded_share": result.summary["frames_degraded"] / max(1, result.summary["frames"]),
    }
    scores: Row = {"frames": 0, **sums, **shares}
    if truth is None:
        return scores
    use = truth.known & record.valid & (record.times >= record.times[0] + SETTLED)
    if not use.any():
        return scores
    poses, true, covariances = record.poses[use], truth.poses[use], record.covariances[use]
    off: Array = poses[:, :3, 3] - true[:, :3, 3]
    return scores | {
        "frames": int(use.sum()),
        "sum_square_m2": float((off**2).sum()),
        "sum_variance_m2": float(covariances[:, :3, :3].trace(axis1=1, axis2=2).sum()),
        "sum_nees": float(nees(pose_tangent_error(poses, true), covariances).sum()),
    }


@dataclass(frozen=True)
class Pooled:
    """Scores over the frames of several runs; NaN without any.

    Attributes
    ----------
    error, claimed : float
        RMS position error, and what the filter said that it was, metres.
    nees : float
        Mean NEES of the pose (6).
    """

    error: float
    claimed: float
    nees: float


def pooled(rows: Sequence[Row]) -> Pooled:
    """Scores over all frames of these rows."""
    frames = sum(row["frames"] for row in rows)
    sums = [sum(row[key] for row in rows) for key in ("sum_square_m2", "sum_variance_m2", "sum_nees")]
    square, variance, total = (x / frames if frames else float("nan") for x in sums)
    return Pooled(float(np.sqrt(square)), float(np.sqrt(variance)), total)


def values(rows: Sequence[Row], key: str) -> list[Any]:
    """What the rows have under a key, each once, in order."""
    return sorted({row[key] for row in rows})


def of(rows: Sequence[Row], **wanted: Any) -> list[Row]:
    """The rows that have these values."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]

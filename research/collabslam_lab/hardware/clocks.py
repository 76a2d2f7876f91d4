"""What a clock of Cf's own costs: views between frames, at other rates, late, or with wrong stamps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from collabslam import Settings, run
from collabslam.datasets.emulated.free_running import FreeRunning, WornAt, WornClock
from collabslam.datasets.wrapped import FirstFrames
from collabslam.demo import corridor_recording
from collabslam.demo.demo_run import HeldRecording
from collabslam.demo.recording import DemoRecording
from collabslam.evaluation.consistency import nees, pose_tangent_error
from collabslam.runs.runner import RunResult
from collabslam.types import Array
from collabslam_lab.hardware.wrong_stamps import AHEAD, CORRIDOR, KNOWN, WrongStamps, side_by_side

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
OFFSETS_MS = (0.0, 10.0, 20.0, 50.0)
FEW_OFFSETS_MS = (0.0, 20.0)
WAYS = (CORRIDOR, "turn90-0")


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
        held = HeldRecording(world if frames is None else FirstFrames(world, frames), progress=False)
        worn = _worn_of(world)
        for clock in dict.fromkeys((TOGETHER, *clocks)):
            result = run(FreeRunning(held, worn, clock))
            yield {
                "seed": seed,
                "rate_hz": clock.rate,
                "phase_s": clock.phase,
                "late_s": clock.late,
                **_scores(result),
            }


def _worn_of(world: DemoRecording) -> WornAt:
    """What Cf sees at a time, whatever the clock.

    The noise of a view and of its T_CF is that of the nearest frame's instant, so that clocks are compared
    without the luck of the draw, which is larger than what they cost.
    """
    taken = cache(lambda tick: world.worn_at(1e-4 * tick, round(1e-4 * tick * TOGETHER.rate)))
    return lambda t, _: taken(round(1e4 * t))


def offset_rows(
    seeds: Sequence[int], ways: Sequence[str], offsets_ms: Sequence[float], frames: int | None = None
) -> Iterator[Row]:
    """One row for each way, seed, certainty of T_CF, offset, and whether the filter is told of the offset."""
    for way in ways:
        for seed in seeds:
            world = side_by_side(way, seed, frames)
            for ms in offsets_ms:
                for known, sds in KNOWN.items():
                    for told in (False, True) if ms else (False,):
                        changes = {"filter.worn.clock_sd": ms / 1e3} if told else {}
                        wrong = WrongStamps(world, ms / 1e3, sds)
                        result = run(wrong, start="worn", settings=Settings.default().replace(changes))
                        row = {"way": way, "seed": seed, "t_cf": known, "offset_ms": ms, "told": told}
                        yield row | _scores(result)


def _scores(result: RunResult) -> Row:
    """Sums over the frames that count: see `pooled`."""
    record, truth = result.record, result.truth
    sums = dict.fromkeys(("sum_square_m2", "sum_variance_m2", "sum_nees"), 0.0)
    scores: Row = {"frames": 0, **sums, "ok_share": result.summary["ok_share"]}
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

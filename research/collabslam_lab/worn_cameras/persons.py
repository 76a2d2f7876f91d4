"""Several persons: is the covariance consistent with each more, does each help, and what does it cost?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

from collabslam.batch.engines import Engine
from collabslam.evaluation.consistency import nees_band
from collabslam.runs.progress import Progress
from collabslam.runs.report import number
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.worn_cameras.among_points import COMMON, Told, Variant, run_points
from collabslam_lab.worn_cameras.persons_trajectory import DRAWS, GROUPS, NAMES, Went, go_along

RUNS, QUICK_RUNS, BATCH = 100, 10, 10
"""Runs among points, and how many of them a child process does at a time."""
TRAJECTORIES, QUICK_TRAJECTORIES = 10, 2
FRAMES, QUICK_FRAMES = 41, 21
COUNTS = tuple(range(1, len(NAMES) + 1))
OWN, TRACKER, UNTOLD = "own", "tracker", "tracker, not told"
"""Whose the errors of T_CF are: each person's own, or partly a tracker's, of which the filter may be told."""
AIM = 9
"""Trajectories of ten on which two persons are to be better than one."""

Out = TypeVar("Out")


def make(*, seed: int, jobs: int, engine: Engine, quick: bool) -> Finding:
    """All runs among points, and all trajectories."""
    runs = QUICK_RUNS if quick else RUNS
    told = _among_points(runs, seed, jobs, engine)
    frames, draws = (QUICK_FRAMES, 2) if quick else (FRAMES, DRAWS)
    trajectories = _each(
        go_along,
        [
            (trajectory, frames, draws, seed)
            for trajectory in range(QUICK_TRAJECTORIES if quick else TRAJECTORIES)
        ],
        jobs,
        engine,
    )
    nees = {kind: {count: _summary(told[kind, count], runs) for count in COUNTS} for kind in (OWN, TRACKER)}
    untold = {count: _summary(told[UNTOLD, count], runs) for count in COUNTS[1:]}
    group = dict(zip(COUNTS, GROUPS, strict=False))
    of_all = np.array(
        [[_rms([went.error for went in trajectory[one]]) for one in GROUPS] for trajectory in trajectories]
    )
    errors, second = of_all[:, :-1], of_all[:, -1]
    either = np.sqrt(0.5 * (errors[:, 0] ** 2 + second**2))
    ms = {
        count: float(np.median([went.ms for trajectory in trajectories for went in trajectory[group[count]]]))
        for count in COUNTS
    }
    rendered = {
        count: _rendered([went for trajectory in trajectories for went in trajectory[group[count]]])
        for count in COUNTS
    }
    numbers: dict[str, Any] = {
        "nees": {count: nees[OWN][count]["pose"] for count in COUNTS},
        "nees_one_tracker": {count: nees[TRACKER][count]["pose"] for count in COUNTS},
        "nees_band": list(nees_band(6, runs)),
        "trajectories_better_with_two": int((errors[:, 1] < errors[:, 0]).sum()),
        "trajectories_better_than_second": int((errors[:, 1] < second).sum()),
        "trajectories_better_than_either": int((errors[:, 1] < either).sum()),
        "error_of_second_m": _rms(second),
        "two_less_mean_of_both_m": _rms(
            [_apart(trajectory, draw) for trajectory in trajectories for draw in range(draws)]
        ),
        "error_by_images_m": {
            count: _parts([trajectory[group[count]] for trajectory in trajectories])[0] for count in COUNTS
        },
        "error_by_t_cf_m": {
            count: _parts([trajectory[group[count]] for trajectory in trajectories])[1] for count in COUNTS
        },
        "trajectories_better_with_three": int((errors[:, 2] < errors[:, 1]).sum()),
        "trajectories": len(trajectories),
        "ms": ms,
        "error_m": {count: _rms(errors[:, k]) for k, count in enumerate(COUNTS)},
        "among_points": {OWN: nees[OWN], TRACKER: nees[TRACKER], UNTOLD: untold},
        "rendered": rendered,
        "runs": runs,
    }
    figure, panels = style.canvas(1, 3, (13.0, 4.4), "Several persons")
    _draw_nees(panels[0, 0], numbers)
    axes = panels[0, 1]
    for row in errors:
        axes.plot(COUNTS, 100.0 * row, color=style.GREY, linewidth=0.8)
    axes.plot(COUNTS, [100.0 * numbers["error_m"][count] for count in COUNTS], "o-", color=style.COLLAB)
    axes.set(xlabel="persons", ylabel="error of the position (cm)", xticks=COUNTS)
    axes = panels[0, 2]
    axes.plot(COUNTS, [ms[count] for count in COUNTS], "o-", color=style.COLLAB)
    axes.set(xlabel="persons", ylabel="a frame with views (ms)", xticks=COUNTS, ylim=(0.0, None))
    return Finding(
        title="Several persons",
        figure=figure,
        tables=[_consistency(told, runs), _help(numbers, rendered)],
        verdict=f"One tracker: {COMMON:.0%} of the variance of each T_CF is common to all. An error on one "
        f"is the RMS over its frames and over {draws} errors of T_CF.",
        numbers=numbers,
        columns=("trajectory", *(f"error_m_{count}" for count in COUNTS), "error_m_second"),
        rows=[[trajectory, *row] for trajectory, row in enumerate(of_all.tolist())],
    )


def _apart(trajectory: dict[tuple[int, ...], list[Went]], draw: int) -> float:
    """RMS distance of two persons' error of the position from the mean of each one's alone, metres."""
    first, both, _, second = (trajectory[group][draw].errors for group in GROUPS)
    last = min(len(first), len(both), len(second))
    away = both[-last:] - 0.5 * (first[-last:] + second[-last:])
    return _rms(np.linalg.norm(away, axis=1))


def _parts(trajectories: list[list[Went]]) -> tuple[float, float]:
    """Of the position's error what all draws of one share, the images' part, and what they do not, T_CF's.

    RMS over frames and trajectories, metres.
    """
    shared, own = [], []
    for went in trajectories:
        last = min(len(one.errors) for one in went)
        errors = np.array([one.errors[-last:] for one in went])
        mean = errors.mean(axis=0)
        shared.append(_rms(np.linalg.norm(mean, axis=1)))
        free = len(went) / max(1, len(went) - 1)
        own.append(np.sqrt(free) * _rms(np.linalg.norm(errors - mean, axis=2)))
    return _rms(shared), _rms(own)


def _among_points(runs: int, seed: int, jobs: int, engine: Engine) -> dict[tuple[str, int], list[Told]]:
    variants = {
        **{(OWN, count): Variant(count, 0.0, 0.0) for count in COUNTS},
        **{(TRACKER, count): Variant(count, COMMON, COMMON) for count in COUNTS},
        **{(UNTOLD, count): Variant(count, COMMON, 0.0) for count in COUNTS[1:]},
    }
    batches = [range(first, min(first + BATCH, runs)) for first in range(0, runs, BATCH)]
    work = [(key, (variant, seed, batch)) for key, variant in variants.items() for batch in batches]
    out: dict[tuple[str, int], list[Told]] = {key: [] for key in variants}
    for (key, _), told in zip(work, _each(run_points, [w for _, w in work], jobs, engine), strict=True):
        out[key] += told
    return out


def _each(do: Callable[..., Out], work: Sequence[tuple[Any, ...]], jobs: int, engine: Engine) -> list[Out]:
    """What ``do`` gives for each, in order."""
    with Progress(len(work), "persons", unit="part") as bar:
        return engine.in_order(do, work, jobs, bar.update)


def _summary(told: list[Told], runs: int) -> dict[str, float]:
    """Mean NEES over runs and frames, and the share of frames whose mean over the runs is within its band."""
    out = {}
    for name, dof in (("pose", 6), ("position", 3), ("worn", 6)):
        values = np.array([getattr(one, name) for one in told])
        some = np.isfinite(values).any(axis=0)
        means = np.nanmean(values[:, some], axis=0)
        low, high = nees_band(dof, runs)
        out[name] = float(means.mean())
        if name != "worn":
            out[f"{name}_in_band"] = float(np.mean((means >= low) & (means <= high)))
    out["error_m"] = _rms(np.concatenate([one.error[1:] for one in told]))
    return out


def _rendered(went: list[Went]) -> dict[str, float]:
    worn = np.array([value for one in went for value in one.worn])
    return {
        "nees_pose": float(np.mean([one.pose for one in went])),
        "nees_position": float(np.mean([one.position for one in went])),
        "nees_worn": float(np.nanmean(worn)),
        "matches": float(np.mean([one.matches for one in went])),
    }


def _draw_nees(axes: Any, numbers: dict[str, Any]) -> None:
    low, high = numbers["nees_band"]
    axes.axhspan(low, high, color=style.GREY, alpha=0.3, linewidth=0.0)
    for name, values in (("errors of their own", "nees"), ("one tracker", "nees_one_tracker")):
        axes.plot(COUNTS, [numbers[values][count] for count in COUNTS], "o-", label=name)
    untold = numbers["among_points"][UNTOLD]
    axes.plot(list(untold), [of["pose"] for of in untold.values()], "x:", label="one tracker, not told")
    axes.set(xlabel="persons", ylabel="NEES of the pose (6)", xticks=COUNTS, ylim=(0.0, None))
    axes.legend()


def _consistency(told: dict[tuple[str, int], list[Told]], runs: int) -> Table:
    rows = []
    for (kind, count), each in told.items():
        of = _summary(each, runs)
        values = [number(of[name], 2) for name in ("pose", "position", "worn")]
        rows.append([kind, str(count), *values, number(100.0 * of["error_m"], 2)])
    low, high = nees_band(6, runs)
    return Table(
        f"Among simulated points, {runs} runs: mean NEES (a pose's 95 % band over the runs of one frame: "
        f"{low:.2f} to {high:.2f}; a position's expectation is 3), and the error of the position:",
        ("errors of T_CF", "persons", "pose of Cs", "position of Cs", "poses of the Cf", "cm"),
        rows,
    )


def _help(numbers: dict[str, Any], rendered: dict[int, dict[str, float]]) -> Table:
    rows = [
        [
            str(count),
            number(100.0 * numbers["error_m"][count], 2),
            *(number(rendered[count][name], 2) for name in ("nees_pose", "nees_position", "nees_worn")),
            number(rendered[count]["matches"], 1),
            number(numbers["ms"][count], 1),
        ]
        for count in COUNTS
    ]
    return Table(
        f"On {numbers['trajectories']} rendered trajectories: two persons are better than one on "
        f"{numbers['trajectories_better_with_two']} (aim: {AIM} of 10), three better than two on "
        f"{numbers['trajectories_better_with_three']}. The second alone errs by "
        f"{100.0 * numbers['error_of_second_m']:.2f} cm; two are better than that one on "
        f"{numbers['trajectories_better_than_second']}, than either (the RMS of both alone) on "
        f"{numbers['trajectories_better_than_either']}. Their error is the mean of the two alone to "
        f"{100.0 * numbers['two_less_mean_of_both_m']:.2f} cm (RMS).",
        ("persons", "error, cm", "NEES pose", "NEES position", "NEES of the Cf", "matches", "ms"),
        rows,
    )


def _rms(values: Any) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))

"""Not in the paper: is the worn camera's pose from laser scans and AHRSs as good as it says?"""

from __future__ import annotations

from typing import Any

import numpy as np

from collabslam.evaluation.consistency import nees_band
from collabslam.runs.report import number
from collabslam.types import Array
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.paper_simulation.case import Case
from collabslam_lab.paper_simulation.estimators import PLAIN
from collabslam_lab.paper_simulation.monte_carlo import Study
from collabslam_lab.paper_simulation.statistics import mean_over_runs
from collabslam_lab.paper_simulation.worn_run import RATE, START, WornOutcome

FALSE = 0.5
"""Metres of error from which the estimate is of something else than the person."""
_AXES = ("x (right)", "y (down)", "z (ahead)", "pitch (about x)", "yaw (about y)", "roll (about z)")
_KEYS = ("x", "y", "z", "pitch", "yaw", "roll")
_GAP = 0.15
_LEAST_RUNS = 0.5
"""Share of the runs that must have a pose at an instant whose mean NEES is put to the test."""


def make(study: Study) -> Finding:
    """Random walks through simulated corridors and rooms, with furniture, other people and gaps."""
    request = Case("worn", PLAIN, "mono")
    o: WornOutcome = study.gather([request], "worn-pose")[request]
    runs = len(o.nees)
    numbers = {"runs": runs, "seed": study.seed, "told": int(study.settings.worn_told), **summary(o)}
    t = START + np.arange(o.nees.shape[1]) / RATE
    curves = {
        "position_error_m": mean_over_runs(_length(o.error[..., :3])),
        "angle_error_deg": np.degrees(mean_over_runs(_length(o.error[..., 3:]))),
        "nees": mean_over_runs(o.nees),
        "share": np.isfinite(o.nees).mean(axis=0),
    }
    title = f"Worn camera's pose from laser scans and AHRSs, {runs} walks"
    figure, panels = style.canvas(2, 2, (12.0, 7.0), title, sharex=True)
    labels = ("position error (m)", "angle error (deg)", "NEES (6)", "share of walks with a pose")
    for axes, label, curve in zip(panels.flat, labels, curves.values(), strict=True):
        axes.plot(t, curve, color=style.COLLAB, linewidth=1.7, label="mean over walks")
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0.0)
    panels[1, 0].axhspan(
        *nees_band(6, runs), color=style.INK, alpha=0.15, linewidth=0, label="95 % band of all walks"
    )
    style.legend(panels[1, 0])
    for axes in panels[1]:
        axes.set_xlabel("time (s)")
    return Finding(
        title="The worn camera's pose from laser scans and AHRSs",
        figure=figure,
        tables=_tables(numbers),
        verdict=(
            "The paper states no error of this pose. The simulation knows nothing of the estimator's "
            "models: feet rest on the floor while they bear weight, heads sway with the steps, attitudes "
            "drift as sums of sines, and nobody is built exactly as measured. A mean NEES in its band can "
            "hide two faults that cancel, a few wrong persons and a covariance that is too large for the "
            "right one: their rows, and the instants, say how much of that there is."
        ),
        numbers=numbers,
        columns=["t_s", *curves],
        rows=np.stack([t, *curves.values()], axis=1).tolist(),
    )


def summary(o: WornOutcome) -> dict[str, Any]:
    """Numbers of the table from the outcomes of many walks."""
    runs = len(o.nees)
    there = np.isfinite(o.nees)
    position, angle = _length(o.error[..., :3]), np.degrees(_length(o.error[..., 3:]))
    bridged = there & (o.since_seen > _GAP)
    right = there & ~(position > FALSE)
    counts = there.sum(axis=0)
    tested = np.flatnonzero(counts >= max(2.0, _LEAST_RUNS * runs))
    inside = [_in_band(float(np.nanmean(o.nees[:, k])), int(counts[k])) for k in tested]
    return {
        "poses": int(there.sum()),
        "share_with_pose": float(there.mean()),
        "share_bridged": float(bridged.sum() / max(1, there.sum())),
        "found_after_s": float(np.nanmedian(o.found)) if np.isfinite(o.found).any() else float("nan"),
        "never_found": int((~np.isfinite(o.found)).sum()),
        "false_person_share": float((position[there] > FALSE).mean()) if there.any() else float("nan"),
        "position_cm": 100.0 * _mean(position),
        "position_median_cm": 100.0 * float(np.median(position[there])) if there.any() else float("nan"),
        "position_95_cm": 100.0 * float(np.quantile(position[there], 0.95)) if there.any() else float("nan"),
        "angle_deg": _mean(angle),
        "nees": _mean(o.nees),
        "nees_band": list(nees_band(6, runs)),
        "nees_position": _mean(o.nees_position),
        "nees_rotation": _mean(o.nees_rotation),
        "nees_part_band": list(nees_band(3, runs)),
        "nees_bridged": _mean(o.nees[bridged]),
        "nees_right_person": _mean(o.nees[right]),
        "instants_in_band": float(np.mean(inside)) if inside else float("nan"),
        "axes": {
            key: {
                "rms": float(np.sqrt(np.nanmean(o.error[..., i] ** 2))),
                "stated": float(np.sqrt(np.nanmean(o.variance[..., i]))),
                "nees": float(np.nanmean(o.error[..., i] ** 2 / o.variance[..., i])),
            }
            for i, key in enumerate(_KEYS)
        },
        "nees_axis_band": list(nees_band(1, runs)),
    }


def _tables(n: dict[str, Any]) -> list[Table]:
    low, high = n["nees_band"]
    part, axis = n["nees_part_band"], n["nees_axis_band"]
    rows = [
        ["images with a pose", f"{100.0 * n['share_with_pose']:.1f} %"],
        ["... of them over a gap", f"{100.0 * n['share_bridged']:.1f} %"],
        ["found after, median", f"{n['found_after_s']:.1f} s"],
        ["walks in which nobody was found", str(n["never_found"])],
        [f"wrong by more than {FALSE} m (false person)", f"{100.0 * n['false_person_share']:.2f} %"],
        ["position error: mean, median, 95 %",
         ", ".join(f"{n[k]:.1f}" for k in ("position_cm", "position_median_cm", "position_95_cm")) + " cm"],
        ["angle error, mean", f"{n['angle_deg']:.2f} deg"],
        [f"NEES of the pose (6; band {low:.2f} to {high:.2f})", number(n["nees"], 2)],
        ["... where the person is the right one", number(n["nees_right_person"], 2)],
        ["... over gaps", number(n["nees_bridged"], 2)],
        [f"NEES of the position (3; band {part[0]:.2f} to {part[1]:.2f})", number(n["nees_position"], 2)],
        ["NEES of the rotation (3; same band)", number(n["nees_rotation"], 2)],
        ["instants whose mean NEES is in its 95 % band", f"{100.0 * n['instants_in_band']:.0f} %"],
    ]  # fmt: skip
    told = "The estimator is told, to 0.2 m, where the person starts" if n["told"] else "Nothing is told"
    caption = f"{n['runs']} walks, {n['poses']} poses. {told}. Bands are of means over independent walks:"
    axes = [
        [name, _both(n["axes"][key]["rms"], i), _both(n["axes"][key]["stated"], i),
         number(n["axes"][key]["nees"], 2)]
        for i, (name, key) in enumerate(zip(_AXES, _KEYS, strict=True))
    ]  # fmt: skip
    by_axis = f"By axis of F; the 95 % band of each NEES is {axis[0]:.2f} to {axis[1]:.2f}:"
    return [
        Table(caption, ("what", "value"), rows),
        Table(by_axis, ("axis", "rms error", "stated", "NEES (1)"), axes),
    ]


def _both(value: float, axis: int) -> str:
    return f"{100.0 * value:.1f} cm" if axis < 3 else f"{np.degrees(value):.2f} deg"


def _in_band(mean: float, runs: int) -> bool:
    low, high = nees_band(6, runs)
    return low <= mean <= high


def _length(errors: Array) -> Array:
    return np.asarray(np.linalg.norm(errors, axis=-1))


def _mean(values: Array) -> float:
    good = values[np.isfinite(values)]
    return float(good.mean()) if good.size else float("nan")

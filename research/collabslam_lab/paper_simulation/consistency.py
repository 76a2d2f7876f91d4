"""Not in the paper: does the covariance of the real 6-DoF filter tell the truth, without and with the
transport?"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from collabslam.evaluation.consistency import nees_band
from collabslam.runs.report import number
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.paper_simulation.case import Case
from collabslam_lab.paper_simulation.cloud import CloudOutcome
from collabslam_lab.paper_simulation.estimators import ESTIMATORS, PLAIN
from collabslam_lab.paper_simulation.monte_carlo import Study
from collabslam_lab.paper_simulation.statistics import mean_over_runs
from collabslam_lab.paper_simulation.windows import shade_windows

_GAUGE = next(e for e in ESTIMATORS if e.name == "gauge-only")
_KINDS = {"plain": PLAIN, "gauge": _GAUGE}
_MODES = ("mono", "collab-tight")
_LABELS = {"plain": "plain EKF", "gauge": "gauge transport"}


def make(study: Study) -> Finding:
    """The core's ``estimator.consistency`` none and gauge, in modes mono and collab-tight, run by run the
    same data."""
    s = study.settings
    requests = {(m, k): Case("cloud", e, m) for m in _MODES for k, e in _KINDS.items()}
    done = study.gather(requests.values(), "consistency")
    outcomes: dict[tuple[str, str], CloudOutcome] = {key: done[request] for key, request in requests.items()}
    runs = int(s.cloud_runs)
    numbers: dict[str, Any] = {"runs": runs, "seed": study.seed, "nees_band": list(nees_band(3, runs))}
    table = []
    for (mode, kind), o in outcomes.items():
        row = _row(o)
        numbers.setdefault(mode, {})[kind] = row
        table.append(
            [
                mode,
                _LABELS[kind],
                "-",
                *(number(row[k], 2) for k in ("nees_position", "nees_attitude", "nees_pose")),
                *(number(row[k], 3) for k in ("log_position", "log_attitude")),
                *(number(row[k], 2) for k in ("nees_position_end", "nees_attitude_end")),
                number(row["average_m"], 3),
                number(row["final_m"], 3),
                number(row["attitude_deg"], 2),
            ]
        )
    t = np.arange(s.frames) / s.rate
    columns, curves = ["t_s"], [t]
    figure, panels = style.canvas(
        3,
        2,
        (13.0, 10.0),
        f"Consistency of the 6-DoF core, {runs} runs with simulated points",
        sharex=True,
        sharey="row",
    )
    for j, mode in enumerate(_MODES):
        for kind in _KINDS:
            o = outcomes[mode, kind]
            for i, (what, values) in enumerate(
                (("error_m", o.error), ("nees_position", o.nees_position), ("nees_attitude", o.nees_attitude))
            ):
                mean = mean_over_runs(values)
                colour = style.MONO if kind == "plain" else style.COLOURS["gauge"]
                panels[i, j].plot(t, mean, color=colour, linewidth=1.7, label=_LABELS[kind])
                columns.append(f"{mode}_{kind}_{what}")
                curves.append(mean)
        for axes in panels[1:, j]:
            axes.axhspan(*nees_band(3, runs), color=style.INK, alpha=0.15, linewidth=0, label="95 % band")
        if mode != "mono":
            for axes in panels[:, j]:
                shade_windows(axes, s, "worn camera at hand")
        panels[0, j].set_title(f"mode {mode}", fontsize=10)
        panels[2, j].set_xlabel("time (s)")
        style.legend(panels[0, j])
        style.legend(panels[1, j])
    for axes, label in zip(
        panels[:, 0], ("position error (m)", "NEES, position (3)", "NEES, attitude (3)"), strict=True
    ):
        axes.set_ylabel(label)
        axes.set_xlim(0.0, s.duration)
    low, high = nees_band(3, runs)
    caption = (
        "NEES averaged over time and runs; expected 3 for position and attitude, 6 for the pose, and "
        f"{low:.2f} to {high:.2f} is the 95 % band of 3 for a mean over these runs at one instant:"
    )
    header = (
        "mode", "filter", "paper", "NEES position", "NEES attitude", "NEES pose", "ln(position / 3)",
        "ln(attitude / 3)", "position, end", "attitude, end", "average error, m", "final error, m",
        "attitude error, deg",
    )  # fmt: skip
    return Finding(
        title="Consistency of the 6-DoF filter",
        figure=figure,
        tables=[Table(caption, header, table)],
        verdict=(
            "The paper says nothing of consistency. Motion and noise are here exactly what the filter "
            "assumes, so this shows what linearisation alone does, not that the filter is consistent on "
            "real images."
        ),
        numbers=numbers,
        columns=columns,
        rows=np.stack(curves, axis=1).tolist(),
    )


def _row(o: CloudOutcome) -> dict[str, float]:
    position, attitude = float(np.nanmean(o.nees_position)), float(np.nanmean(o.nees_attitude))
    return {
        "nees_position": position,
        "nees_attitude": attitude,
        "nees_pose": float(np.nanmean(o.nees_pose)),
        "log_position": math.log(position / 3.0),
        "log_attitude": math.log(attitude / 3.0),
        "nees_position_end": float(o.nees_position[:, -1].mean()),
        "nees_attitude_end": float(o.nees_attitude[:, -1].mean()),
        "average_m": float(o.error.mean()),
        "final_m": float(o.error[:, -1].mean()),
        "attitude_deg": float(np.degrees(o.attitude_error.mean())),
    }

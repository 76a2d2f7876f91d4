"""Table 1: ten corridors."""

from __future__ import annotations

from collections.abc import Sequence

from collabslam.runs.report import number
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.paper_worlds.cases import DIRECT, SENSORS, UNCALIBRATED, Case, CaseResult, Row
from collabslam_lab.paper_worlds.drawing import LINES
from collabslam_lab.paper_worlds.tables import (
    SOURCES,
    Aim,
    all_started,
    average_share,
    by_sequence,
    cases_of,
    chosen,
    mean,
    modes_in,
    no_strawman,
    rows_of,
    scored,
)

PAPER = {"mono": (694.0, 5.56, 6.78, None), "collab": (276.0, 2.21, 3.17, 0.387)}
"""Sum and average of the position error, error at the end (metres), share of time with overlap."""


def cases(quick: bool) -> list[Case]:
    """The corridors."""
    return cases_of("corridor", quick)


def make(results: Sequence[CaseResult]) -> Finding:
    """The paper's rows beside ours."""
    rows = rows_of(results)
    aims = {poses: _aims(rows, poses) for poses in SOURCES}
    header = (
        "approach", "pose of the worn camera", "runs", "sum of position errors, m",
        "average error, m", "error at the end, m", "overlap, s/s", "average error, % of the path",
    )  # fmt: skip
    lines = []
    for mode, (total, average, final, overlap) in PAPER.items():
        ours = [f"{mode} (paper)", "laser and AHRS", "10", f"{total:.0f}", f"{average:.2f}", f"{final:.2f}"]
        lines.append([*ours, number(overlap, 3), number(100.0 * average / 15.0, 1)])
    for poses in SOURCES:
        for mode in modes_in([r for r in rows if r["poses"] == poses]):
            group = chosen(rows, mode, poses)
            line = [mode, SOURCES[poses], str(len(group))]
            line += [number(mean(group, "sum_position_error_m"), 1)]
            line += [number(mean(group, k), 3) for k in ("avg_position_error_m", "final_position_error_m")]
            share = sum(average_share(r) for r in group) / max(len(group), 1)
            lines.append([*line, number(mean(group, "overlap_ratio"), 3), number(share, 2)])
    figure, panels = style.canvas(1, 2, (11.0, 4.6), "Table 1: corridors", sharey=True)
    for axes, poses in zip(panels[0], (SENSORS, DIRECT), strict=True):
        for mode in modes_in(rows):
            group = by_sequence(chosen(rows, mode, poses))
            names = [r["sequence"].removeprefix("corridor-") for r in group]
            values = [r["avg_position_error_m"] for r in group]
            colour, dashes = LINES[mode]
            axes.plot(names, values, color=colour, linestyle=dashes, marker="o", label=mode)
        axes.set_title(f"pose of the worn camera: {SOURCES[poses]}", fontsize=10)
        axes.set_xlabel("corridor")
    panels[0, 0].set_ylabel("average position error (m)")
    panels[0, 0].set_ylim(bottom=0.0)
    style.legend(panels[0, 0])
    return scored(
        Table("Means over the runs:", header, lines),
        rows,
        aims,
        title="Table 1: average errors in corridors",
        figure=figure,
        verdict=(
            "The corridors are rendered, the paper's are not public: ours show what the method does with the "
            "same geometry, speed, optics and sensors, not on the same walls. All modes start from the same "
            "first overlap, so `mono` has a metric scale too."
        ),
        paper=PAPER,
    )


def _aims(rows: Sequence[Row], poses: str) -> list[Aim]:
    mono, collab = chosen(rows, "mono", poses), chosen(rows, "collab", poses)
    ratio = mean(collab, "avg_position_error_m") / mean(mono, "avg_position_error_m")
    share = sum(average_share(r) for r in collab) / max(len(collab), 1)
    last = max((float(r["final_error_pct"]) for r in collab), default=float("nan"))
    return [
        Aim("average error, collab over mono", ratio, "<=", 0.4),
        Aim("average error of collab, % of the path", share, "<=", 3.0),
        Aim("largest error of collab at the end, % of the path", last, "<=", 6.0),
        all_started(rows, poses),
        *(no_strawman(rows, poses) if poses != UNCALIBRATED else []),
    ]

"""Table 2 and figure 14: ten ways with straights and turns."""

from __future__ import annotations

from collections.abc import Sequence

from collabslam.runs.report import number
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.paper_worlds.cases import DIRECT, SENSORS, Case, CaseResult, Row
from collabslam_lab.paper_worlds.drawing import draw_tracks
from collabslam_lab.paper_worlds.tables import (
    SOURCES,
    Aim,
    all_started,
    by_sequence,
    cases_of,
    chosen,
    mean,
    no_strawman,
    rows_of,
    scored,
)

PAPER = {
    "a": (3.88, 3.17, 1.24, 0.82, 0.23, 1.9, 1.4, 33.8),
    "b": (2.84, 2.00, 1.19, 0.69, 0.32, 1.1, 0.7, 36.9),
    "c": (4.12, 3.04, 2.51, 1.72, 0.22, 1.4, 1.2, 126.2),
    "d": (3.19, 2.26, 1.46, 0.98, 0.27, 2.2, 2.9, 54.3),
    "e": (5.32, 4.12, 2.43, 1.73, 0.38, 3.4, 2.5, 223.1),
    "f": (3.45, 2.15, 1.68, 1.28, 0.37, 2.8, 3.3, 115.6),
    "g": (4.83, 3.34, 1.74, 1.12, 0.58, 4.1, 1.8, 159.1),
    "h": (3.96, 2.87, 1.97, 1.34, 0.33, 1.7, 2.3, 122.4),
    "i": (5.91, 4.43, 2.73, 2.26, 0.49, 1.6, 0.8, 316.7),
    "j": (4.73, 3.92, 2.35, 1.54, 0.44, 3.8, 3.2, 232.5),
}
"""Final and average error of DI-D, of the collaborative filter (metres), overlap ratio, tau, kappa, U."""


def cases(quick: bool) -> list[Case]:
    """The ten ways."""
    return cases_of("general", quick)


def make(results: Sequence[CaseResult]) -> Finding:
    """The paper's table and ours."""
    rows = rows_of(results)
    aims = {poses: _aims(rows, poses) for poses in (SENSORS, DIRECT)}
    lines, means = [], by_sequence(rows)
    for name in dict.fromkeys(r.case.name for r in results):
        lines.append([name, "paper", "-", *(f"{x:g}" for x in PAPER[name])])
        lines += [[name, SOURCES[poses], *_line(means, name, poses)] for poses in (SENSORS, DIRECT)]
    header = (
        "sequence", "from", "path, m", "mono: at the end, m", "average, m", "collab: at the end, m",
        "average, m", "overlap, s/s", "tau", "kappa", "U",
    )  # fmt: skip
    shown = results[:3]
    figure, panels = style.canvas(1, len(shown), (4.2 * len(shown), 4.2), "Figure 14: ways a, b and c")
    for axes, result in zip(panels[0], shown, strict=True):
        draw_tracks(axes, result, SENSORS, ("mono", "collab"), result.case.name)
    panels[0, 0].legend(fontsize=8.5)
    return scored(
        Table(
            "The paper's rows and ours, means over the seeds (overlap, tau, kappa, U of `collab`):",
            header,
            lines,
        ),
        rows,
        aims,
        title="Table 2: ways with straights and turns",
        figure=figure,
        verdict=(
            "The ways are our own, with the paper's shares of overlap aimed at; when the views overlap "
            "follows from where the person walks and looks."
        ),
        paper=PAPER,
    )


def _line(means: Sequence[Row], name: str, poses: str) -> list[str]:
    ours = {r["mode"]: r for r in means if r["sequence"] == name and r["poses"] == poses}
    mono, collab = ours.get("mono", {}), ours.get("collab", {})
    both = [(r, k) for r in (mono, collab) for k in ("final_position_error_m", "avg_position_error_m")]
    return [
        number(collab.get("path_length_m"), 2),
        *(number(r.get(k), 3) for r, k in both),
        *(number(collab.get(k), 2) for k in ("overlap_ratio", "tau", "kappa", "U")),
    ]


def _aims(rows: Sequence[Row], poses: str) -> list[Aim]:
    mono = {r["sequence"]: r for r in by_sequence(chosen(rows, "mono", poses))}
    collab = by_sequence(chosen(rows, "collab", poses))

    def better(key: str) -> float:
        won = [r[key] < mono[r["sequence"]][key] for r in collab if r["sequence"] in mono]
        return float(sum(won)) / max(len(collab), 1)

    return [
        Aim("share of ways on which collab is better than mono", better("avg_position_error_m"), ">=", 1.0),
        Aim("the same by the error at the end", better("final_position_error_m"), ">=", 1.0),
        Aim("mean error of collab at the end, % of the path", mean(collab, "final_error_pct"), "<=", 3.0),
        all_started(rows, poses),
        *no_strawman(rows, poses),
    ]

"""Figures 11 and 12: the worst and the average corridor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collabslam.runs.report import number
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.paper_worlds.cases import DIRECT, SENSORS, Case, CaseResult
from collabslam_lab.paper_worlds.drawing import draw_tracks
from collabslam_lab.paper_worlds.tables import COLUMNS, SOURCES, cases_of, cells

PAPER = [
    ["mono", "average", "8.9 m of 15 m advanced", "noticeable"],
    ["collab", "worst", "about 60 % of 15 m advanced", "huge"],
    ["collab", "average", "less than 1 m short of 15 m", "9.5"],
]


def cases(quick: bool) -> list[Case]:
    """The corridors."""
    return cases_of("corridor", quick)


def make(results: Sequence[CaseResult]) -> Finding:
    """Trajectories of the sequences with the largest and with the middle error of `mono`."""
    figure, panels = style.canvas(2, 2, (11.0, 6.5), "Figures 11 and 12: the worst and the average corridor")
    lines, rows = [["paper", *row[:2], "-", row[2], row[3]] for row in PAPER], []
    for row_of_panels, poses in zip(panels, (SENSORS, DIRECT), strict=True):
        ordered = sorted(
            (r for r in results if r.case.seed == results[0].case.seed), key=lambda r: _error(r, poses)
        )
        picked = {"worst": ordered[-1], "average": ordered[len(ordered) // 2]}
        for axes, (case, result) in zip(row_of_panels, picked.items(), strict=True):
            name = result.case.name
            draw_tracks(axes, result, poses, ("mono", "collab"), f"{case}, {name}, {SOURCES[poses]}")
            for mode in ("mono", "collab"):
                row = result.row(mode, poses)
                rows.append(row)
                end = np.array(result.tracks[f"{mode}/{poses}"][-1]) - result.tracks[f"{mode}/{poses}"][0]
                way = f"{np.hypot(*end):.2f} of {row['path_length_m']:.2f} m advanced"
                lines.append([name, mode, case, SOURCES[poses], way, number(row["heading_error_deg"], 2)])
    panels[0, 0].legend(fontsize=8.5)
    return Finding(
        title="Figures 11 and 12: trajectories in corridors",
        figure=figure,
        tables=[
            Table(
                "Worst and average are those of `mono`, with the first seed:",
                ("sequence", "mode", "case", "pose of the worn camera", "way", "heading error, degrees"),
                lines,
            )
        ],
        verdict="Every mode starts from the same first overlap; the paper's start from known features.",
        numbers={"rows": rows},
        columns=COLUMNS,
        rows=cells(rows),
    )


def _error(result: CaseResult, poses: str) -> float:
    value = result.row("mono", poses).get("avg_position_error_m")
    return float("inf") if value is None else float(value)

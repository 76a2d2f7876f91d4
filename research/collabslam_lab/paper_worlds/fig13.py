"""Figure 13: close turns of 90 and 180 degrees."""

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
    cases_of,
    chosen,
    mean,
    modes_in,
    no_strawman,
    rows_of,
    scored,
)

TURNS = ("turn90", "turn180")
PAPER = [
    ["turn90", "mono (paper)", "laser and AHRS", "1", "almost 80 too far", "-", "-", "-"],
    ["turn180", "mono (paper)", "laser and AHRS", "1", "lost", "-", "-", "-"],
    ["turn180", "collab (paper)", "laser and AHRS", "1", "21.4", "-", "0.94", "14.1"],
]


def cases(quick: bool) -> list[Case]:
    """Both sets of turns."""
    return [case for turn in TURNS for case in cases_of(turn, quick)[: 1 if quick else None]]


def make(results: Sequence[CaseResult]) -> Finding:
    """Errors at the end of the turns."""
    rows = rows_of(results)
    lines = list(PAPER)
    aims: dict[str, list[Aim]] = {}
    for poses in (SENSORS, DIRECT):
        aims[poses] = []
        for turn in TURNS:
            group = [r for r in rows if r["sequence"].startswith(f"{turn}-")]
            lines += [
                [turn, mode, SOURCES[poses], *_line(chosen(group, mode, poses))] for mode in modes_in(rows)
            ]
            aims[poses] += _aims(turn, chosen(group, "collab", poses))
        aims[poses] += [all_started(rows, poses), *no_strawman(rows, poses)]
    figure, panels = style.canvas(
        2, 2, (11.0, 8.0), "Figure 13: turns of 90 and 180 degrees, the first of each"
    )
    for row_of_panels, poses in zip(panels, (SENSORS, DIRECT), strict=True):
        for axes, turn in zip(row_of_panels, TURNS, strict=True):
            first = next(r for r in results if r.case.name.startswith(f"{turn}-"))
            draw_tracks(axes, first, poses, ("mono", "collab"), f"{first.case.name}, {SOURCES[poses]}")
    panels[0, 0].legend(fontsize=8.5)
    header = (
        "turn", "approach", "pose of the worn camera", "runs", "heading error at the end, degrees",
        "largest", "error at the end, m", "% of the path",
    )  # fmt: skip
    return scored(
        Table("Means over the runs:", header, lines),
        rows,
        aims,
        title="Figure 13: close turns",
        figure=figure,
        verdict="Robot at 0.8 m/s; ten turns of each kind, to both sides, the person inside or outside.",
    )


def _line(group: Sequence[Row]) -> list[str]:
    largest = max((float(r["heading_error_deg"]) for r in group), default=float("nan"))
    return [
        str(len(group)),
        number(mean(group, "heading_error_deg"), 2),
        number(largest, 2),
        number(mean(group, "final_position_error_m"), 3),
        number(mean(group, "final_error_pct"), 2),
    ]


def _aims(turn: str, collab: Sequence[Row]) -> list[Aim]:
    nothing = float("nan")
    heading = max((float(r["heading_error_deg"]) for r in collab), default=nothing)
    final = max((float(r["final_error_pct"]) for r in collab), default=nothing)
    ok = min((r["frames_ok"] / r["frames"] for r in collab), default=nothing)
    return [
        Aim(f"{turn}: largest heading error of collab at the end, degrees", heading, "<=", 5.0),
        Aim(f"{turn}: largest error of collab at the end, % of the path", final, "<=", 5.0),
        Aim(f"{turn}: least share of frames OK of collab", ok, ">=", 1.0),
    ]

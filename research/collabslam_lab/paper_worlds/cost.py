"""What pseudo-stereo costs: its share of the time, on average and where it is paid in every frame."""

from __future__ import annotations

from collections.abc import Sequence

from collabslam.runs.report import number
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.paper_worlds import table2
from collabslam_lab.paper_worlds.cases import DIRECT, SENSORS, Case, CaseResult, Row
from collabslam_lab.paper_worlds.tables import COLUMNS, SOURCES, by_sequence, cells, chosen, mean, rows_of

PAPER_SHARE, PAPER_WORST, PAPER_OVERLAP = 0.23, 0.45, 0.37


def cases(quick: bool) -> list[Case]:
    """The ten ways."""
    return table2.cases(quick)


def make(results: Sequence[CaseResult]) -> Finding:
    """Share of the time, and the times."""
    rows = rows_of(results)
    lines = [["paper (MATLAB)", "23 %", "45 %", "37 %", "-", "-", "-", "-"]]
    numbers = {}
    for poses in (SENSORS, DIRECT):
        group, mono = chosen(rows, "collab", poses), chosen(rows, "mono", poses)
        share = mean(group, "ms_pseudo_stereo") / mean(group, "ms_per_frame")
        worst = max((_share_in_overlap(r) for r in group), default=float("nan"))
        numbers[poses] = {
            "share": share,
            "worst_share": worst,
            "overlap_ratio": mean(group, "overlap_ratio"),
            "ms_per_frame": mean(group, "ms_per_frame"),
            "ms_pseudo_stereo": mean(group, "ms_pseudo_stereo"),
            "ms_pseudo_stereo_overlap": mean(group, "ms_pseudo_stereo_overlap"),
            "ms_per_frame_mono": mean(mono, "ms_per_frame"),
        }
        n = numbers[poses]
        lines.append(
            [
                SOURCES[poses],
                *(number(n[k], 0, "%", 100.0) for k in ("share", "worst_share", "overlap_ratio")),
                *(number(n[k], 1) for k in ("ms_per_frame", "ms_pseudo_stereo", "ms_pseudo_stereo_overlap")),
                number(n["ms_per_frame_mono"], 1),
            ]
        )
    figure, panels = style.canvas(1, 1, (9.0, 4.4), "Time a frame, pose of the worn camera from its sensors")
    axes, group = panels[0, 0], by_sequence(chosen(rows, "collab", SENSORS))
    names = [r["sequence"] for r in group]
    parts = [float(r["ms_pseudo_stereo"]) for r in group]
    axes.bar(names, [r["ms_per_frame"] for r in group], color=style.GREY, label="all else")
    axes.bar(names, parts, color=style.COLLAB, label="pseudo-stereo")
    axes.set_ylabel("ms a frame")
    style.legend(axes)
    header = (
        "pose of the worn camera", "share of pseudo-stereo", "worst: overlap in every frame", "overlap",
        "ms a frame", "of it pseudo-stereo", "in a frame with overlap", "ms a frame of mono",
    )  # fmt: skip
    return Finding(
        title="What pseudo-stereo costs",
        figure=figure,
        tables=[Table("`collab` on the ten ways:", header, lines)],
        verdict=(
            "The worst case is the sequence with the largest share in its frames with overlap, as if "
            "every frame were one. Times are of this machine, one thread each; the shares hardly differ."
        ),
        numbers={"rows": rows, "cost": numbers},
        columns=COLUMNS,
        rows=cells(rows),
    )


def _share_in_overlap(row: Row) -> float:
    part, whole = row.get("ms_pseudo_stereo_overlap"), row.get("ms_per_frame_overlap")
    return float("nan") if part is None or whole is None else float(part / whole)

"""Figure 15: error at the end against the share of time with overlap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collabslam.runs.report import number
from collabslam.types import Array
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.paper_worlds import table2
from collabslam_lab.paper_worlds.cases import DIRECT, SENSORS, Case, CaseResult
from collabslam_lab.paper_worlds.tables import COLUMNS, SOURCES, by_sequence, cells, chosen, rows_of


def cases(quick: bool) -> list[Case]:
    """The ten ways."""
    return table2.cases(quick)


def make(results: Sequence[CaseResult]) -> Finding:
    """Gain against overlap, ours and the paper's."""
    rows = rows_of(results)
    figure, panels = style.canvas(1, 3, (13.0, 4.6), "Figure 15: error at the end against overlap")
    paper = np.array([table2.PAPER[name] for name in dict.fromkeys(r.case.name for r in results)])
    curves = {"paper": (paper[:, 4], paper[:, 0], paper[:, 2])}
    for poses in (SENSORS, DIRECT):
        mono, collab = (by_sequence(chosen(rows, mode, poses)) for mode in ("mono", "collab"))
        common = [(m, c) for m in mono for c in collab if m["sequence"] == c["sequence"]]
        key = "final_position_error_m"
        values = [(c["overlap_ratio"], m[key], c[key]) for m, c in common]
        x, a, b = np.array(values, float).reshape(-1, 3).T
        curves[SOURCES[poses]] = (x, a, b)
    lines, numbers = [], {}
    for axes, (name, (x, mono_end, collab_end)) in zip(panels[0], curves.items(), strict=True):
        axes.vlines(x, mono_end, collab_end, color=style.GREY, linewidth=1.0)
        axes.plot(x, mono_end, "o", color=style.MONO, label="mono")
        axes.plot(x, collab_end, "o", color=style.COLLAB, label="collab")
        axes.set_title(name, fontsize=10)
        axes.set_xlabel("overlap (s/s)")
        gain = _correlation(x, mono_end - collab_end)
        share = _correlation(x, collab_end / mono_end)
        lines.append([name, number(gain, 2), number(share, 2)])
        numbers[name] = {"gain": gain, "ratio": share}
    panels[0, 0].set_ylabel("error at the end (m)")
    style.legend(panels[0, 0])
    header = ("from", "correlation of overlap with the gain, m", "with collab / mono")
    return Finding(
        title="Figure 15: error at the end against overlap",
        figure=figure,
        tables=[Table("Over the sequences, means over the seeds:", header, lines)],
        verdict="Ten ways that differ in length and turns say little of overlap; the study varies it alone.",
        numbers={"rows": rows, "correlation": numbers},
        columns=COLUMNS,
        rows=cells(rows),
    )


def _correlation(x: Array, y: Array) -> float | None:
    if len(x) < 3 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return None
    return float(np.corrcoef(x, y)[0, 1])

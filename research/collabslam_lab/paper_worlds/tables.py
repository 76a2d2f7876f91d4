"""What the experiments' pages share: rows as CSV columns, means over recordings, aims reached or missed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from collabslam.runs.report import number
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.paper_worlds import paired
from collabslam_lab.paper_worlds.cases import DIRECT, MODES, SENSORS, UNCALIBRATED, Case, CaseResult, Row
from collabslam_lab.worlds import SETS

COLUMNS = (
    "sequence", "seed", "mode", "poses", "path_length_m", "avg_position_error_m", "sum_position_error_m",
    "final_position_error_m", "final_error_pct", "heading_error_deg", "overlap_ratio", "matched_ratio",
    "tau", "kappa", "U",
    "frames", "frames_ok", "frames_ok_reported", "frames_lost", "features_per_frame", "scale_error",
    "nees_mean", "ms_per_frame", "ms_pseudo_stereo", "ms_pseudo_stereo_overlap", "ms_per_frame_overlap",
)  # fmt: skip
SOURCES = {
    SENSORS: "laser and AHRS",
    UNCALIBRATED: "laser and AHRS, person not calibrated",
    DIRECT: "measured directly",
}
QUICK_COUNT = 2
_AIMED = ("mono", "collab")


def cases_of(name: str, quick: bool) -> list[Case]:
    """The recordings of a set; with `quick` the first ones, without the modes that take no part in an aim.
    In corridors the person's calibration is left out as well."""
    recipes = SETS[name][:QUICK_COUNT] if quick else SETS[name]
    modes = _AIMED if quick else MODES
    runs = [(mode, poses) for poses in (SENSORS, DIRECT) for mode in modes]
    if name == "corridor":
        runs += [(mode, UNCALIBRATED) for mode in _AIMED]
    return [Case(r.name, tuple(runs)) for r in recipes]


def rows_of(results: Sequence[CaseResult]) -> list[Row]:
    """All rows, recording after recording."""
    return [row for result in results for row in result.rows]


def cells(rows: Sequence[Row], columns: Sequence[str] = COLUMNS) -> list[list[Any]]:
    """The rows of the CSV file."""
    return [["" if row.get(c) is None else row[c] for c in columns] for row in rows]


def chosen(rows: Sequence[Row], mode: str, poses: str) -> list[Row]:
    """Rows of a mode and a source of poses whose filter started."""
    return [
        r for r in rows if r["mode"] == mode and r["poses"] == poses and r.get("final_error_pct") is not None
    ]


def mean(rows: Sequence[Row], key: str) -> float:
    """Over the rows that have it; NaN if none has."""
    values = [float(r[key]) for r in rows if r.get(key) is not None]
    return float(np.mean(values)) if values else float("nan")


def by_sequence(rows: Sequence[Row]) -> list[Row]:
    """Means over the seeds: a row for each sequence, mode and source of poses that started at least once."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        if row.get("final_error_pct") is not None:
            groups.setdefault((row["sequence"], row["mode"], row["poses"]), []).append(row)
    keys = [key for key in COLUMNS if key not in ("sequence", "seed", "mode", "poses")]
    out = []
    for (sequence, mode, poses), group in groups.items():
        means = {key: mean(group, key) for key in keys}
        known = {key: value if np.isfinite(value) else None for key, value in means.items()}
        out.append({"sequence": sequence, "mode": mode, "poses": poses, "runs": len(group), **known})
    return out


def average_share(row: Row) -> float:
    """Average position error as a share of the path, percent."""
    if row.get("avg_position_error_m") is None:
        return float("nan")
    return 100.0 * float(row["avg_position_error_m"]) / float(row["path_length_m"])


def modes_in(rows: Sequence[Row]) -> list[str]:
    """The modes that were run, in the usual order."""
    return [m for m in MODES if any(r["mode"] == m for r in rows)]


class Aim(NamedTuple):
    """What is aimed at, what was reached (NaN if nothing was run), and the bound: ``<=`` or ``>=`` what."""

    what: str
    reached: float
    relation: str
    bound: float

    @property
    def met(self) -> bool:
        """Whether the bound is kept; no number keeps none."""
        return self.reached <= self.bound if self.relation == "<=" else self.reached >= self.bound


def scored(
    table: Table,
    rows: Sequence[Row],
    aims: Mapping[str, Sequence[Aim]],
    *,
    title: str,
    figure: Figure,
    verdict: str,
    paper: Any = None,
) -> Finding:
    """The page of a set of recordings: its own table, the aims by source of poses, and every row."""
    gains = paired.gains([{**r, "share": average_share(r)} for r in rows])
    numbers = {"rows": rows, "aims": _aims_numbers(aims), "paired": [asdict(g) for g in gains]}
    return Finding(
        title=title,
        figure=figure,
        tables=[table, _aims_table(aims), paired.table(gains), _each_row_table(by_sequence(rows))],
        verdict=verdict,
        numbers=numbers if paper is None else {**numbers, "paper": paper},
        columns=COLUMNS,
        rows=cells(rows),
    )


def _aims_table(aims: Mapping[str, Sequence[Aim]]) -> Table:
    lines = []
    for poses, entries in aims.items():
        for aim in entries:
            text = "not run" if not np.isfinite(aim.reached) else ("yes" if aim.met else "NO")
            bound = f"{aim.relation} {aim.bound:g}"
            lines.append([aim.what, SOURCES[poses], bound, number(aim.reached, 2), text])
    return Table("Aims:", ("aim", "pose of the worn camera", "bound", "reached", "met"), lines)


def _aims_numbers(aims: Mapping[str, Sequence[Aim]]) -> list[dict[str, Any]]:
    return [
        {
            "aim": aim.what,
            "poses": poses,
            "relation": aim.relation,
            "bound": aim.bound,
            "reached": aim.reached if np.isfinite(aim.reached) else None,
            "met": bool(aim.met),
        }
        for poses, entries in aims.items()
        for aim in entries
    ]


def all_started(rows: Sequence[Row], poses: str) -> Aim:
    """Whether `collab` started on every recording: one that did not is in none of the means."""
    asked = sum(r["mode"] == "collab" and r["poses"] == poses for r in rows)
    share = len(chosen(rows, "collab", poses)) / asked
    return Aim("runs in which collab started, of all", share, ">=", 1.0)


def no_strawman(rows: Sequence[Row], poses: str) -> list[Aim]:
    """`mono` tracks as much as `collab`, and is no worse than `mono-undelayed`."""
    mono, collab = chosen(rows, "mono", poses), chosen(rows, "collab", poses)
    features = mean(mono, "features_per_frame") / mean(collab, "features_per_frame")
    undelayed = mean(chosen(rows, "mono-undelayed", poses), "avg_position_error_m")
    error = mean(mono, "avg_position_error_m") / undelayed
    return [
        Aim("features a frame, mono over collab", features, ">=", 0.9),
        Aim("average error, mono over mono-undelayed", error, "<=", 1.0),
    ]


def _each_row_table(rows: Sequence[Row]) -> Table:
    columns: list[tuple[str, Callable[[Row], str]]] = [
        ("sequence", lambda r: str(r["sequence"])),
        ("mode", lambda r: str(r["mode"])),
        ("pose of the worn camera", lambda r: SOURCES[r["poses"]]),
        ("path, m", lambda r: number(r.get("path_length_m"), 2)),
        ("average error, m", lambda r: number(r.get("avg_position_error_m"), 3)),
        ("error at the end, m", lambda r: number(r.get("final_position_error_m"), 3)),
        ("% of the path", lambda r: number(r.get("final_error_pct"), 2)),
        ("heading error, degrees", lambda r: number(r.get("heading_error_deg"), 2)),
        ("frames OK", lambda r: f"{number(r['frames_ok'], 0)} of {number(r['frames'], 0)}"),
        ("runs", lambda r: str(r["runs"])),
        ("ms a frame", lambda r: number(r.get("ms_per_frame"), 1)),
    ]
    lines = [[text(r) for _, text in columns] for r in rows]
    return Table("Every sequence and mode, means over the seeds:", [c for c, _ in columns], lines)

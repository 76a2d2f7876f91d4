"""The paper's future work: error against availability, overlap, and the noise of the worn camera's pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from collabslam.runs.report import number
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.paper_worlds.cases import Case, CaseResult, Row
from collabslam_lab.paper_worlds.drawing import LINES
from collabslam_lab.paper_worlds.tables import COLUMNS, average_share, cells, rows_of
from collabslam_lab.paper_worlds.variants import ANGLE_SD, AVAILABLE, POSITION_SD, Variant
from collabslam_lab.worlds import SETS

POINTS = {
    "availability": (0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0),
    "overlap": (0.3, 0.45, 0.6, 0.8, 1.0),
    "position_sd": (0.01, 0.02, 0.03, 0.05, 0.1, 0.2),
    "angle_sd": (0.2, 0.5, 1.0, 2.0, 5.0),
}
LABELS = {
    "availability": "share of time in which the worn camera is there",
    "overlap": "share of each side of its picture that is left",
    "position_sd": "sd of its position (m)",
    "angle_sd": "sd of its heading (degrees; half of it in roll and pitch)",
}
_QUICK = 2
_TICKS = (0.1, 0.3, 1.0, 3.0, 10.0)


def cases(quick: bool) -> list[Case]:
    """Ten corridors with a person who always looks along; two, and the ends of each curve, with `quick`."""
    points = {k: (v[0], v[-1]) if quick else v for k, v in POINTS.items()}
    variants = tuple(
        Variant(factor, value, mode)
        for factor, values in points.items()
        for value in values
        for mode in _modes(factor, value)
    )
    recipes = SETS["study"][:_QUICK] if quick else SETS["study"]
    return [Case(r.name, variants=variants) for r in recipes]


def _modes(factor: str, value: float) -> tuple[str, ...]:
    if factor == "availability":
        return ("collab",) if value > 0.0 else ("mono",)
    return "mono", "collab"


def make(results: Sequence[CaseResult]) -> Finding:
    """A curve for each factor and mode."""
    rows = rows_of(results)
    figure, panels = style.canvas(2, 2, (11.0, 8.0), "Error against what the worn camera gives", sharey=True)
    lines, numbers = [], dict[str, list[dict[str, Any]]]()
    for axes, (factor, label) in zip(panels.flat, LABELS.items(), strict=True):
        numbers[factor] = []
        for mode in ("mono", "collab"):
            curve = _curve(rows, factor, mode)
            colour, dashes = LINES[mode]
            values = [p["value"] for p in curve]
            axes.fill_between(
                values, [p["p10"] for p in curve], [p["p90"] for p in curve], color=colour, alpha=0.2
            )
            middle = [p["median"] for p in curve]
            axes.plot(values, middle, color=colour, linestyle=dashes, marker="o", label=mode)
            for p in curve:
                shares = (number(float(p[k]), 2) for k in ("median", "p10", "p90", "mean"))
                lines.append([label, f"{p['value']:g}", mode, str(p["runs"]), *shares])
            numbers[factor] += [{k: _plain(v) for k, v in point.items()} for point in curve]
        if factor.endswith("_sd"):
            axes.set_xscale("log")
            axes.set_xticks(POINTS[factor], [f"{value:g}" for value in POINTS[factor]])
        axes.set_yscale("log")
        axes.set_yticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
        axes.minorticks_off()
        axes.set_xlabel(label)
        axes.set_ylabel("average error, % of the path")
    style.legend(panels[1, 0])
    header = (
        "factor",
        "value",
        "mode",
        "runs that started",
        "median average error, % of the path",
        "10th percentile",
        "90th",
        "mean",
    )
    return Finding(
        title="Error against availability, overlap and noise of the worn camera",
        figure=figure,
        tables=[Table("Corridors of 15 m, each its own scene, and the seeds of their noise:", header, lines)],
        verdict=(
            f"One factor varies at a time; the others stay at {100 * AVAILABLE:.0f} % availability, the "
            f"whole picture, {100 * POSITION_SD:.0f} cm and {ANGLE_SD:g} degree, independent in each frame. "
            "`mono` has Cf in the first frame only: the better that one is, the less is left to gain."
        ),
        numbers={"rows": rows, "curves": numbers},
        columns=("factor", "value", *COLUMNS),
        rows=cells(rows, ("factor", "value", *COLUMNS)),
    )


def _curve(rows: Sequence[Row], factor: str, mode: str) -> list[dict[str, Any]]:
    """Median, percentiles and mean of the average error, % of the path, at each value."""
    mine = [r for r in rows if r["factor"] == factor and r["mode"] == mode]
    curve = []
    for value in sorted({float(r["value"]) for r in mine}):
        started = [r for r in mine if r["value"] == value and r.get("avg_position_error_m") is not None]
        shares = np.array([average_share(r) for r in started])
        low, middle, high = np.percentile(shares, [10, 50, 90]) if len(shares) else [np.nan] * 3
        mean = float(shares.mean()) if len(shares) else np.nan
        point = {"value": value, "mode": mode, "runs": len(shares), "median": middle, "mean": mean}
        curve.append({**point, "p10": low, "p90": high})
    return curve


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value

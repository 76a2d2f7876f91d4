"""The picture of an evaluation: error and consistency of every run, a column for each recording."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from collabslam.evaluation.consistency import nees_band
from collabslam.formats.files import write_bytes
from collabslam.viz.plot import COLOURS, POINTS
from collabslam_lab.benchmark.plan import Plan
from collabslam_lab.benchmark.store import Row

_PANELS = (
    ("ate_pct_all_frames", "ATE, all frames, % of the path"),
    ("nees_position", "NEES position"),
    ("nees_attitude", "NEES attitude"),
)


def plot_rows(plan: Plan, rows: Sequence[Row], path: Path) -> None:
    """Write the picture: a dot for each seed, hollow for an error of T_CF of its own in each frame."""
    names = [e.name for e in plan.recordings if any(r["recording"] == e.name for r in rows)]
    figure = Figure(figsize=(11.0, 9.0), dpi=100, layout="constrained")
    panels = figure.subplots(len(_PANELS), 1, sharex=True)
    for axes, (key, label) in zip(panels, _PANELS, strict=True):
        _panel(axes, rows, names, key)
        axes.set_ylabel(label)
    for axes in panels[1:]:
        axes.axhspan(*nees_band(3), color="#7bab6a", alpha=0.15, linewidth=0, label="95 % band", zorder=0)
        axes.axhline(3.0, color="#7bab6a", linewidth=1.0, zorder=1)
    panels[-1].set_xticks(range(len(names)), names)
    handles = dict(zip(*reversed(panels[0].get_legend_handles_labels()), strict=True))
    panels[0].legend(handles.values(), handles.keys(), fontsize=9, framealpha=0.9)
    FigureCanvasAgg(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    write_bytes(path, buffer.getvalue())


def _panel(axes: Axes, rows: Sequence[Row], names: Sequence[str], key: str) -> None:
    axes.set_yscale("log")
    axes.grid(color="#e6e8eb", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    modes = list(dict.fromkeys(row["mode"] for row in rows))
    for k, mode in enumerate(modes):
        aside = (k - 0.5 * (len(modes) - 1)) * 0.16
        for independent in (False, True):
            found = [
                (
                    names.index(r["recording"]) + aside + 0.05 * independent,
                    r[key],
                )
                for r in rows
                if r["mode"] == mode and r["independent"] is independent and r.get(key)
            ]
            if found:
                colour = COLOURS.get(mode, POINTS)
                axes.plot(*zip(*found, strict=True), "o", markersize=5, color=colour, zorder=3,
                          markerfacecolor="none" if independent else colour, alpha=0.8,
                          label=f"{mode}, independent" if independent else mode)  # fmt: skip

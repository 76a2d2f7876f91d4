"""One look for every figure."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

INK, GREY, WINDOW = "#1b1b1b", "#8a94a0", "#f2b134"
MONO, COLLAB = "#d1495b", "#1d6fa5"
COLOURS = {
    "plain": "#1d6fa5",
    "independent": "#b5651d",
    "perfect": "#8c6d1f",
    "fej": "#8a94a0",
    "inflated": "#5aa9a3",
    "gauge-only": "#9468bd",
    "gauge": "#2e8b57",
}
RAMP = ("#9ecae1", "#4292c6", "#2171b5", "#08306b")


def canvas(
    rows: int, columns: int, size: tuple[float, float], title: str, **options: Any
) -> tuple[Figure, np.ndarray[tuple[int, int], np.dtype[np.object_]]]:
    """A figure of ``size`` inches with a grid of panels (rows, columns)."""
    figure = Figure(figsize=size, dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=13, fontweight="bold")
    panels = figure.subplots(rows, columns, squeeze=False, **options)
    for axes in panels.flat:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#e6e8eb", linewidth=0.7)
        axes.set_axisbelow(True)
    return figure, panels


def legend(axes: Axes, where: Literal["upper left", "lower left"] = "upper left") -> None:
    """A quiet legend."""
    axes.legend(loc=where, fontsize=8.5, framealpha=0.9)

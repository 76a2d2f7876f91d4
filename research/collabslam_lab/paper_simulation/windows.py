"""Where a figure of the simulation shows that pseudo-stereo is at hand."""

from __future__ import annotations

from matplotlib.axes import Axes

from collabslam_lab.figures.style import WINDOW
from collabslam_lab.paper_simulation.simulation_settings import SimulationSettings


def shade_windows(axes: Axes, s: SimulationSettings, label: str | None = "pseudo-stereo at hand") -> None:
    """Shades the windows of pseudo-stereo."""
    for k, (start, end) in enumerate(s.windows):
        axes.axvspan(
            start, end, color=WINDOW, alpha=0.25, linewidth=0, label=label if k == 0 else None, zorder=0
        )

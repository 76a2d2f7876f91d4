"""Trajectories from above, in the experiments' one look."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from collabslam_lab.figures import style
from collabslam_lab.paper_worlds.cases import CaseResult

LINES = {
    "mono": (style.MONO, "-"),
    "mono-undelayed": (style.MONO, ":"),
    "collab-init": (style.COLLAB, ":"),
    "collab": (style.COLLAB, "-"),
    "collab-tight": (style.COLLAB, "--"),
}


def draw_tracks(axes: Axes, result: CaseResult, poses: str, modes: Sequence[str], title: str) -> None:
    """The true way and what each mode made of it."""
    truth = np.array(result.tracks["truth"])
    axes.plot(*truth.T, color=style.INK, linewidth=1.6, label="truth")
    for mode in modes:
        track = np.array(result.tracks.get(f"{mode}/{poses}", [])).reshape(-1, 2)
        colour, dashes = LINES[mode]
        axes.plot(*track.T, color=colour, linestyle=dashes, linewidth=1.4, label=mode)
    middle, reach = truth.mean(axis=0), 0.75 * np.ptp(truth, axis=0).max() + 1.0
    axes.set_xlim(middle[0] - reach, middle[0] + reach)
    axes.set_ylim(middle[1] - 0.6 * reach, middle[1] + 0.6 * reach)
    axes.set_aspect("equal")
    axes.set_title(title, fontsize=9.5)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")

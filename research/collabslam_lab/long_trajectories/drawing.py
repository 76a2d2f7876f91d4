"""Plan views of long trajectories."""

from __future__ import annotations

import io

from matplotlib.figure import Figure

from collabslam_lab.long_trajectories.walk import Walked


def plan_view(walked: Walked) -> bytes:
    """A picture (PNG) from above: the truth, the odometry, the corrected submaps, and the loops."""
    figure = Figure(figsize=(7.0, 7.0), dpi=100)
    axes = figure.add_subplot()
    lines = [
        (walked.truth, "#1b1b1b", "truth"),
        (walked.trajectory, "#d1495b", "pose"),
        (walked.submaps, "#2a9d6f", "submaps"),
    ]
    for points, colour, label in lines:
        axes.plot(
            points[:, 2], points[:, 0], color=colour, label=label, marker="." if label == "submaps" else ""
        )
    for k, pair in enumerate(walked.pairs):
        ends = walked.submaps[list(pair)]
        axes.plot(ends[:, 2], ends[:, 0], color="#1d6fa5", linewidth=2.5, label="loop" if k == 0 else None)
    axes.set(xlabel="z, m", ylabel="x, m", title=f"{walked.name}: {walked.loops} loops", aspect="equal")
    axes.invert_yaxis()
    axes.legend()
    image = io.BytesIO()
    figure.savefig(image, format="png")
    return image.getvalue()

"""Where the worn cameras were when their views were taken, frame by frame of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from collabslam.results import WornPose

EXACT = (np.nan, np.nan)
"""In a checkpoint, a clock that is exact."""
Places = Mapping[str, WornPose]
"""Those of one frame, by the name of whoever wears the camera."""


def places_state(frames: Sequence[Places]) -> dict[str, dict[str, Any]]:
    """Those of all frames in columns, by name, for a checkpoint."""
    out = {}
    for name in dict.fromkeys(name for places in frames for name in places):
        rows = [(i, places[name]) for i, places in enumerate(frames) if name in places]
        out[name] = {
            "frames": np.array([i for i, _ in rows], np.int64),
            "times": np.array([place.t for _, place in rows], np.float64),
            "poses": np.array([place.pose for _, place in rows], np.float64),
            "covariances": np.array([place.covariance for _, place in rows], np.float64),
            "measured": np.array([place.measured for _, place in rows], bool),
            "matches": np.array([place.matches for _, place in rows], np.int64),
            "clocks": np.array([place.clock or EXACT for _, place in rows], np.float64),
        }
    return out


def places_from(state: Mapping[str, Mapping[str, Any]], count: int) -> list[dict[str, WornPose]]:
    """Those of ``count`` frames, of a `places_state`; KeyError, ValueError or IndexError if it is none."""
    out: list[dict[str, WornPose]] = [{} for _ in range(count)]
    for name, columns in state.items():
        scalars = (columns[key].tolist() for key in ("times", "measured", "matches"))
        rows = zip(
            columns["frames"].tolist(),
            columns["poses"],
            columns["covariances"],
            columns["clocks"].tolist(),
            *scalars,
            strict=True,
        )
        for i, pose, covariance, (offset, sd), t, measured, matches in rows:
            clock = None if np.isnan(sd) else (offset, sd)
            out[i][name] = WornPose(pose, covariance, measured, t, matches, clock)
    return out

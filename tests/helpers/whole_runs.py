"""Whole recordings through the pipeline, in the modes that are compared."""

from __future__ import annotations

from functools import cache
from typing import Any

import collabslam

MODES = ("mono", "collab-tight")
LEAST_NEES, LARGEST_NEES = 0.03, 16.3
"""An error of the scale lasts as long as a run, so that the mean NEES of a run is about one draw of three
numbers and not the mean of a hundred: the upper bound is passed by one draw in a thousand.  Below the lower
one a standard deviation is too large by a factor of ten.
"""


class Rendered:
    """A recording whose frames are rendered once for all runs."""

    def __init__(self, recording: Any) -> None:
        self._recording = recording
        self.frame = cache(recording.frame)

    def __len__(self) -> int:
        return len(self._recording)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._recording, name)


def scores(recording: Any) -> dict[str, dict[str, Any]]:
    """The summary of each mode."""
    rendered: Any = Rendered(recording)
    return {mode: collabslam.run(rendered, mode=mode).summary for mode in MODES}


def check_run(summary: dict[str, Any], largest_ate: float, least_nees: float = LEAST_NEES) -> None:
    """A run that never lost the camera, whose error is small (per cent of the way), and known."""
    assert summary["coverage"] == 1.0
    assert summary["ok_share"] >= 0.98
    assert summary["false_ok_share"] <= 0.02
    assert summary["ate_pct_all_frames"] < largest_ate
    assert least_nees < summary["nees_position"] < LARGEST_NEES
    assert summary["nees_attitude"] < LARGEST_NEES

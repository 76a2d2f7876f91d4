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

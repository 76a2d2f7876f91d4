"""Where the worn cameras were when their views were taken, frame by frame of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from collabslam.types import Array


class Place(Protocol):
    """Where a worn camera was (``view.PlacedCamera``).

    Attributes
    ----------
    t : float
        When, seconds, by the clock of Cs.
    pose : (4, 4) float64
        ``T_WF``.
    covariance : (6, 6) float64
        Of it over (translation, rotation), tangent on the right, m^2 and rad^2.
    measured : bool
        Whether matches of the view tell it.
    matches : int
        How many of the view's matches the filter was given.
    clock : tuple of (float, float) or None
        Seconds by which its views are taken after their stamps, and the standard deviation of that.
    """

    @property
    def t(self) -> float: ...
    @property
    def pose(self) -> Array: ...
    @property
    def covariance(self) -> Array: ...
    @property
    def measured(self) -> bool: ...
    @property
    def matches(self) -> int: ...
    @property
    def clock(self) -> tuple[float, float] | None: ...


EXACT = (np.nan, np.nan)
"""In a checkpoint, a clock that is exact."""
Places = Mapping[str, Place]
"""Those of one frame, by the name of whoever wears the camera."""


@dataclass(frozen=True)
class RecordedPlace:
    """A `Place` read back from a checkpoint."""

    t: float
    pose: Array
    covariance: Array
    measured: bool
    matches: int
    clock: tuple[float, float] | None


def places_of(step: object) -> Places:
    """Those of an engine's answer; none if the engine knows of none."""
    found: Places = getattr(step, "worn", {})
    return found


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


def places_from(state: Mapping[str, Mapping[str, Any]], count: int) -> list[dict[str, RecordedPlace]]:
    """Those of ``count`` frames, of a `places_state`; KeyError, ValueError or IndexError if it is none."""
    out: list[dict[str, RecordedPlace]] = [{} for _ in range(count)]
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
            out[i][name] = RecordedPlace(t, pose, covariance, measured, matches, clock)
    return out

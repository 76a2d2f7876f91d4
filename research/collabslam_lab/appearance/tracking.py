"""What a run says of its images: how much is tracked, for how long, what is refused, and how it misses.

METHOD
The filter is run once with the defaults, and nothing of its pose or of the truth is looked at. Of each frame:
which features were searched, what became of them, where they were expected (the innovation) and where the
updated filter has them (the residual). The residual is what neither the camera's motion nor the map takes
up: blur, rolling shutter, noise, a wrong calibration. How alike it is from frame to frame is its correlation,
over all features that were used in both frames,

    c(k) = sum e(t) . e(t + k) / sqrt(sum |e(t)|^2 sum |e(t + k)|^2).

Standard deviations are robust, 1.48 times the median size, so that a few wrong matches do not make them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from collabslam.results import StepResult
from collabslam.slam.engine import Slam
from collabslam.types import Array, Frame, Ids

LAGS = (1, 10)
"""Frames, of the correlations."""


@dataclass(frozen=True)
class Statistic:
    """Attributes
    ----------
    what : str
        With its unit.
    digits : int
        To print.
    """

    what: str
    digits: int


STATISTICS: dict[str, Statistic] = {
    "features": Statistic("features used a frame", 0),
    "track_frames": Statistic("frames that a feature is used, mean", 1),
    "track_seconds": Statistic("seconds from its first to its last use, mean", 2),
    "unlike": Statistic("share of searches that find nothing like it", 3),
    "ambiguous": Statistic("share that finds it twice", 3),
    "refused": Statistic("share found and refused", 3),
    "motion_px": Statistic("motion of a feature from frame to frame, median, px", 1),
    "innovation_px": Statistic("sd of the innovation, px", 2),
    "residual_px": Statistic("sd of the residual, px", 2),
    "correlation_1": Statistic("correlation of the residual, 1 frame", 2),
    "correlation_10": Statistic("the same, 10 frames", 2),
}
"""What is compared, by name."""


class Tracking:
    """Watches a run (`collabslam.runs.runner.run`'s ``watch``) and sums up what became of its features."""

    def __init__(self) -> None:
        self._frames = 0
        self._times: list[float] = []
        self._ids: list[Ids] = []
        self._numbers: list[Ids] = []
        self._found: list[Array] = []
        self._innovations: list[Array] = []
        self._residuals: list[Array] = []
        self._states: dict[str, int] = {}

    def __call__(self, frame: Frame, step: StepResult, slam: Slam) -> None:
        """Takes a frame."""
        number = len(self._times)
        self._times.append(step.t)
        if not step.started:
            return
        self._frames += 1
        features = step.features
        for state in features.states:
            self._states[state] = self._states.get(state, 0) + 1
        used = np.array([state == "accepted" for state in features.states], bool)
        ids, found = features.ids[used], features.found[used]
        after = slam.filter.predict_pixels()
        order = np.argsort(after.ids)
        place = np.minimum(np.searchsorted(after.ids, ids, sorter=order), max(len(order) - 1, 0))
        updated = np.full((len(ids), 2), np.nan)
        if len(order):
            there = after.ids[order[place]] == ids
            updated[there] = after.uv[order[place]][there]
        self._ids.append(ids)
        self._numbers.append(np.full(len(ids), number, np.int64))
        self._found.append(found)
        self._innovations.append(found - features.predicted[used])
        self._residuals.append(found - updated)

    def statistics(self) -> dict[str, float | None]:
        """Each of `STATISTICS`; None where nothing can be said."""
        uses = _Uses.sorted(
            _joined(self._ids, np.int64),
            _joined(self._numbers, np.int64),
            _joined(self._found).reshape(-1, 2),
            _joined(self._innovations).reshape(-1, 2),
            _joined(self._residuals).reshape(-1, 2),
        )
        if not len(uses.ids):
            return dict.fromkeys(STATISTICS)
        _, first, count = np.unique(uses.ids, return_index=True, return_counts=True)
        times = np.array(self._times)[uses.numbers]
        tried = sum(n for state, n in self._states.items() if state != "not searched")
        share = {state: n / max(tried, 1) for state, n in self._states.items()}
        values: dict[str, Any] = {
            "features": len(uses.ids) / self._frames,
            "track_frames": count.mean(),
            "track_seconds": (times[first + count - 1] - times[first]).mean(),
            "unlike": share.get("unlike", 0.0),
            "ambiguous": share.get("ambiguous", 0.0),
            "refused": share.get("rejected", 0.0),
            "motion_px": uses.motion(),
            "innovation_px": _robust_sd(uses.innovations),
            "residual_px": _robust_sd(uses.residuals),
            **{f"correlation_{lag}": uses.correlation(lag) for lag in LAGS},
        }
        return {k: float(v) if v is not None and np.isfinite(v) else None for k, v in values.items()}


@dataclass(frozen=True)
class _Uses:
    """Every use of a feature, by feature and frame: id, number of the frame, pixel, innovation, residual."""

    ids: Ids
    numbers: Ids
    found: Array
    innovations: Array
    residuals: Array

    @classmethod
    def sorted(cls, ids: Ids, numbers: Ids, *pixels: Array) -> _Uses:
        order = np.lexsort((numbers, ids))
        return cls(ids[order], numbers[order], *(p[order] for p in pixels))

    def pairs(self, lag: int) -> tuple[Ids, Ids]:
        """Uses of one feature that are ``lag`` frames apart."""
        span = int(self.numbers.max(initial=0)) + lag + 1
        keys = self.ids * span + self.numbers
        later = np.minimum(np.searchsorted(keys, keys + lag), len(keys) - 1)
        first = np.flatnonzero(keys[later] == keys + lag)
        return first, later[first]

    def motion(self) -> float | None:
        """Median way of a feature in the image from a frame to the next, pixels."""
        a, b = self.pairs(1)
        return float(np.median(np.linalg.norm(self.found[b] - self.found[a], axis=1))) if len(a) else None

    def correlation(self, lag: int) -> float | None:
        """Of the residuals, after so many frames; None if no feature was used in two such."""
        a, b = self.pairs(lag)
        known = np.isfinite(self.residuals[a]).all(axis=1) & np.isfinite(self.residuals[b]).all(axis=1)
        one, other = self.residuals[a[known]], self.residuals[b[known]]
        size = np.sqrt((one**2).sum() * (other**2).sum())
        return float((one * other).sum() / size) if size > 0.0 else None


def _joined(parts: list[Any], dtype: Any = np.float64) -> Any:
    return np.concatenate(parts) if parts else np.empty(0, dtype)


def _robust_sd(pixels: Array) -> float | None:
    known = np.abs(pixels[np.isfinite(pixels)])
    return float(1.4826 * np.median(known)) if len(known) else None

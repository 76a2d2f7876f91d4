"""What a run leaves behind, frame by frame, for scoring, writing and plotting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from collabslam.errors import DataError
from collabslam.evaluation.worn_places import places_from, places_state
from collabslam.results import StepResult
from collabslam.types import Array, Mask, Status


@dataclass
class RunRecord:
    """Every frame of one run, in order.

    Attributes
    ----------
    steps : list of StepResult
    worn : list of bool
        Whether a view of the worn camera was at hand in that frame (whatever the mode makes of it).
    seconds : list of float
        Wall time of the step, seconds, without reading or rendering the images.
    """

    steps: list[StepResult] = field(default_factory=list)
    worn: list[bool] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"RunRecord of {len(self)} frames, {int(self.valid.sum())} with a pose"

    def append(self, step: StepResult, *, worn: bool, seconds: float) -> None:
        """Add one frame."""
        self.steps.append(step)
        self.worn.append(worn)
        self.seconds.append(seconds)

    def __len__(self) -> int:
        return len(self.steps)

    def state(self) -> dict[str, Any]:
        """All of it, column by column, for a checkpoint."""
        keys = dict.fromkeys(k for s in self.steps for k in s.diagnostics)
        return {
            "times": self.times,
            "poses": self.poses,
            "covariances": self.covariances,
            "statuses": self.statuses,
            "usable": np.array([s.valid for s in self.steps], bool),
            "started": self.started,
            "metric": np.array([s.metric for s in self.steps], bool),
            "scale_sds": np.array([s.scale_sd for s in self.steps], np.float64),
            "poses_map": np.array([s.pose_map for s in self.steps], np.float64).reshape(-1, 4, 4),
            "covariances_map": np.array([s.covariance_map for s in self.steps], np.float64).reshape(-1, 6, 6),
            "worn": np.array(self.worn, bool),
            "seconds": np.array(self.seconds, np.float64),
            "diagnostics": {k: _column([s.diagnostics.get(k) for s in self.steps]) for k in keys},
            "places": places_state([step.worn for step in self.steps]),
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> RunRecord:
        """The record of a `state`.

        Raises
        ------
        DataError
            If it is none.
        """
        try:
            columns = {k: v if isinstance(v, list) else v.tolist() for k, v in state["diagnostics"].items()}
            rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
            frames = zip(
                state["times"].tolist(),
                state["poses"],
                state["covariances"],
                map(Status, state["statuses"]),
                state["usable"].tolist(),
                state["started"].tolist(),
                state["metric"].tolist(),
                state["scale_sds"].tolist(),
                state["poses_map"],
                state["covariances_map"],
                rows or [{} for _ in state["statuses"]],
                places_from(state["places"], len(state["times"])),
                strict=True,
            )
            record = cls([StepResult(*frame) for frame in frames])
            record.worn, record.seconds = state["worn"].tolist(), state["seconds"].tolist()
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            raise DataError("The file holds no record of a run; take an earlier one.") from error
        if not len(record.worn) == len(record.seconds) == len(record):
            raise DataError("The file holds half a record of a run; take an earlier one.")
        return record

    @property
    def times(self) -> Array:
        """(N,) seconds."""
        return np.array([s.t for s in self.steps], np.float64)

    @property
    def poses(self) -> Array:
        """(N, 4, 4) ``T_WC``, valid or not."""
        return np.array([s.pose for s in self.steps], np.float64).reshape(-1, 4, 4)

    @property
    def covariances(self) -> Array:
        """(N, 6, 6)."""
        return np.array([s.covariance for s in self.steps], np.float64).reshape(-1, 6, 6)

    @property
    def statuses(self) -> list[str]:
        """The `Status` of each frame, as text."""
        return [s.status.value for s in self.steps]

    def valid_at(self, index: int) -> bool:
        """Whether the pose of one frame may be used, as `valid` says of all."""
        return is_valid(self.steps[index])

    @property
    def valid(self) -> Mask:
        """(N,) whether the pose may be used: started, not lost, and finite."""
        return np.array([self.valid_at(i) for i in range(len(self))], bool)

    @property
    def finite(self) -> Mask:
        """(N,) whether pose and covariance are finite."""
        return np.asarray(
            np.isfinite(self.poses).all(axis=(1, 2)) & np.isfinite(self.covariances).all(axis=(1, 2))
        )

    @property
    def started(self) -> Mask:
        """(N,) whether the filter has its origin."""
        return np.array([s.started for s in self.steps], bool)

    @property
    def start(self) -> int | None:
        """Index of the frame in which the filter starts; None if it never does."""
        started = np.flatnonzero(self.started)
        return int(started[0]) if len(started) else None

    def origin(self, start: int) -> int | None:
        """Index of the frame up to ``start`` whose pose is W, where a view that came late started the filter
        from it; else None."""
        begun = self.start
        ago = None if begun is None else self.steps[begun].diagnostics.get("start_ago_s")
        if begun is None or ago is None or begun > start:
            return None
        gaps = np.abs(self.times - (self.times[begun] - float(ago)))
        nearest = int(np.argmin(gaps))
        return nearest if gaps[nearest] <= 1e-6 else None

    def diagnostic(self, key: str) -> Array:
        """(N,) values of a numeric diagnostic; NaN where it is absent."""
        values = [s.diagnostics.get(key) for s in self.steps]
        return np.array([np.nan if v is None else float(v) for v in values], np.float64)


def _column(values: list[Any]) -> Any:
    """Values of a diagnostic as an array where they are all floats or all whole numbers, else as they are."""
    kinds = {type(v) for v in values}
    if kinds == {float}:
        return np.array(values, np.float64)
    return np.array(values, np.int64) if kinds == {int} else values


def is_valid(step: StepResult) -> bool:
    """Whether a frame's pose may be used: started, not lost, and finite."""
    finite = np.isfinite(step.pose).all() and np.isfinite(step.covariance).all()
    return bool(step.valid and step.started and finite)

"""What a run leaves behind, frame by frame, for scoring, writing and plotting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from collabslam.types import Array, Ids, Mask


class Step(Protocol):
    """The engine's answer to one frame (``engine.StepResult``).

    Attributes
    ----------
    t : float
        Seconds.
    pose : (4, 4) float64
        ``T_WC``.
    covariance : (6, 6) float64
        Of ``pose`` over (translation, rotation), tangent on the right, m^2 and rad^2.
    status : Status
    valid : bool
        Whether the pose may be used.
    started : bool
        Whether the filter has its origin by now.
    diagnostics : mapping
    """

    @property
    def t(self) -> float: ...
    @property
    def pose(self) -> Array: ...
    @property
    def covariance(self) -> Array: ...
    @property
    def status(self) -> Any: ...
    @property
    def valid(self) -> bool: ...
    @property
    def started(self) -> bool: ...
    @property
    def diagnostics(self) -> Mapping[str, Any]: ...


class Landmarks(Protocol):
    """The map's points: ``ids`` (M,), ``points`` (M, 3) metres in W, ``covariance`` (M, 3, 3) m^2."""

    @property
    def ids(self) -> Ids: ...
    @property
    def points(self) -> Array: ...
    @property
    def covariance(self) -> Array: ...


@dataclass
class RunRecord:
    """Every frame of one run, in order.

    Attributes
    ----------
    steps : list of Step
    worn : list of bool
        Whether a view of the worn camera was at hand in that frame (whatever the mode makes of it).
    seconds : list of float
        Wall time of the step, seconds, without reading or rendering the images.
    """

    steps: list[Step] = field(default_factory=list)
    worn: list[bool] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def append(self, step: Step, *, worn: bool, seconds: float) -> None:
        """Add one frame."""
        self.steps.append(step)
        self.worn.append(worn)
        self.seconds.append(seconds)

    def __len__(self) -> int:
        return len(self.steps)

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
        """OK, COASTING or LOST per frame."""
        return [status_name(s.status) for s in self.steps]

    @property
    def valid(self) -> Mask:
        """(N,) whether the pose may be used: started, not lost, and finite."""
        flags = np.array([bool(s.valid and s.started) for s in self.steps], bool)
        return flags & self.finite

    @property
    def finite(self) -> Mask:
        """(N,) whether pose and covariance are finite."""
        return np.asarray(
            np.isfinite(self.poses).all(axis=(1, 2)) & np.isfinite(self.covariances).all(axis=(1, 2))
        )

    @property
    def started(self) -> Mask:
        """(N,) whether the filter has its origin."""
        return np.array([bool(s.started) for s in self.steps], bool)

    @property
    def start(self) -> int | None:
        """Index of the frame in which the filter starts; None if it never does."""
        started = np.flatnonzero(self.started)
        return int(started[0]) if len(started) else None

    def diagnostic(self, key: str) -> Array:
        """(N,) values of a numeric diagnostic; NaN where it is absent."""
        values = [s.diagnostics.get(key) for s in self.steps]
        return np.array([np.nan if v is None else float(v) for v in values], np.float64)


def status_name(status: Any) -> str:
    """``OK``, ``COASTING`` or ``LOST`` of a Status or its name."""
    return str(getattr(status, "value", status))

"""What the engine answers: a frame's pose and status, and the map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from collabslam.formats.trajectory import ARBITRARY, METRES
from collabslam.slam.feature_states import FrameFeatures
from collabslam.types import Array, Ids, Status


@dataclass(frozen=True)
class StepResult:
    """What is known after a frame.

    Attributes
    ----------
    t : float
        Time stamp, seconds.
    pose : (4, 4) float64
        T_WC: maps points of Cs into W (Cs's optical frame at the start), metres.
    covariance : (6, 6) float64
        Of the pose over (translation, rotation), tangent on the right, m^2 and rad^2.
    status : Status
        OK, DOUBTFUL, COASTING or LOST.
    valid : bool
        Whether the pose may be used: the filter has started and is not LOST.
    started : bool
        Whether there is a map to localise in.
    diagnostics : dict
        Counts, reasons of rejection, milliseconds per stage.
    features : FrameFeatures
        What became of each feature that should be visible.
    metric : bool
        Whether lengths are metres; otherwise they are in a unit that the start chose, and that drifts.
    scale_sd : float
        Relative standard deviation of the scale: all distances from the camera to the map may be too long or
        too short by this share together.  Infinite where lengths are no metres, and before the start.
    """

    t: float
    pose: Array
    covariance: Array
    status: Status
    valid: bool
    started: bool
    diagnostics: dict[str, Any]
    features: FrameFeatures
    metric: bool
    scale_sd: float

    @property
    def unit(self) -> str:
        """Of lengths: `METRES` or `ARBITRARY`."""
        return METRES if self.metric else ARBITRARY


@dataclass(frozen=True)
class Landmarks:
    """The map: ``ids`` (N,) int64, ``points`` (N, 3) metres in W, ``covariance`` (N, 3, 3) m^2."""

    ids: Ids
    points: Array
    covariance: Array

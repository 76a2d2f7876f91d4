"""What the engine answers: a frame's pose and status, and the map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from collabslam._core import pose_inverse
from collabslam.formats.trajectory import ARBITRARY, METRES
from collabslam.slam.feature_states import FrameFeatures
from collabslam.slam.view import PlacedCamera
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
    pose_map, covariance_map : (4, 4), (6, 6) float64
        The same pose in the map of all submaps, as loops correct it, and its covariance.  ``pose`` and
        ``covariance`` until one is found: those never jump when an earlier place is recognised, these do.
    worn : dict
        Where the worn cameras are whose views this frame used or looked at, by name; a `PlacedCamera` each.
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
    pose_map: Array
    covariance_map: Array
    worn: Mapping[str, PlacedCamera] = field(default_factory=dict)

    @property
    def t_map_odom(self) -> Array:
        """(4, 4): what moves ``pose`` to ``pose_map``, from the world of the odometry into the map."""
        return np.asarray(self.pose_map @ pose_inverse(self.pose))

    @property
    def unit(self) -> str:
        """Of lengths: `METRES` or `ARBITRARY`."""
        return METRES if self.metric else ARBITRARY


@dataclass(frozen=True)
class Loop:
    """An earlier submap that was recognised.

    Attributes
    ----------
    first, second : int
        The submap seen, and the one at whose end it was seen.
    t_first, t_second : float
        When they ended, seconds.
    matches : int
        Landmarks that it rests on.
    residual_m, residual_deg : float
        By how much the camera is elsewhere than the graph had it, seen from the first.
    chi2 : float
        The same, squared against its covariance: of 6 degrees of freedom.
    """

    first: int
    second: int
    t_first: float
    t_second: float
    matches: int
    residual_m: float
    residual_deg: float
    chi2: float


@dataclass(frozen=True)
class Landmarks:
    """The map: ``ids`` (N,) int64, ``points`` (N, 3) metres in W, ``covariance`` (N, 3, 3) m^2."""

    ids: Ids
    points: Array
    covariance: Array


@dataclass(frozen=True)
class SubmapPoses:
    """The submaps of a way, as the loops of the whole way correct them.

    Attributes
    ----------
    times : (N,) float64
        Of their ends, seconds.
    poses, covariances : (N, 4, 4), (N, 6, 6) float64
        T_WC there, and what is known of it; right tangent, m^2 and rad^2.
    odometry : (N, 4, 4) float64
        The same poses as the filter had them.
    loops : list of Loop
    landmarks : Landmarks
        The map of the whole way; of a landmark in several submaps, as the last of them has it.
    """

    times: Array
    poses: Array
    covariances: Array
    odometry: Array
    loops: list[Loop]
    landmarks: Landmarks

    def corrected(self, times: Array, poses: Array) -> Array:
        """Poses (M, 4, 4) of the filter's at some times (M,), moved as the submap that ended last was."""
        if not len(self.times):
            return poses
        last = np.maximum(np.searchsorted(self.times, times, side="right") - 1, 0)
        return np.asarray((self.poses @ np.linalg.inv(self.odometry))[last] @ poses)

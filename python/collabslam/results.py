"""What the filter answers: a frame's pose and status, where worn cameras were, the map, submaps and loops."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from collabslam._core import Prediction, pose_inverse, rotation_log
from collabslam.bound import Bound, bounds
from collabslam.level import Level
from collabslam.types import Array, Brief, Ids, Mask, Status

FEATURE_STATES = ("accepted", "rejected", "unlike", "ambiguous", "outside", "not searched")
"""Used by the filter; found but refused; patch not found; found twice; outside the image; not looked for."""
CELL = 8
"""Pixels along a side of the squares of `FrameFeatures.left_out`."""


@dataclass(frozen=True, repr=False)
class FrameFeatures(Brief):
    """The features that should be visible in a frame.

    Attributes
    ----------
    ids : (N,) int64
    predicted : (N, 2) float64
        Pixels where they are expected.
    s : (N, 2, 2) float64
        Innovation covariance of those, px^2.
    found : (N, 2) float64
        Pixels where they were found; NaN elsewhere.
    states : (N,) of str
        One of `FEATURE_STATES` each.
    pairs : (M, 4) float64
        What both cameras see: pixels in Cs, when Cf took its view, and in Cf; of several worn cameras one
        after the other.
    pair_names : list of str
        Whose worn camera each pair is of.
    left_out : (h, w) bool or None
        Which squares of `CELL` pixels of Cs were left alone, from the upper left one on: masked, or of who
        wears a Cf, or fixed to the camera; None if none.
    """

    ids: Ids = field(default_factory=lambda: np.empty(0, np.int64))
    predicted: Array = field(default_factory=lambda: np.empty((0, 2)))
    s: Array = field(default_factory=lambda: np.empty((0, 2, 2)))
    found: Array = field(default_factory=lambda: np.empty((0, 2)))
    states: list[str] = field(default_factory=list)
    pairs: Array = field(default_factory=lambda: np.empty((0, 4)))
    pair_names: list[str] = field(default_factory=list)
    left_out: Mask | None = None

    @classmethod
    def unsearched(cls, expected: Prediction) -> FrameFeatures:
        """The features of a frame in which none was searched."""
        nowhere, states = np.full((len(expected.ids), 2), np.nan), ["not searched"] * len(expected.ids)
        return cls(expected.ids, expected.uv, expected.s, nowhere, states)

    def pairs_of(self, name: str) -> Array:
        """(K, 4) the pairs of one worn camera."""
        return np.asarray(self.pairs[np.array([whose == name for whose in self.pair_names], bool)])


@dataclass(frozen=True, repr=False)
class WornPose(Brief):
    """Where a worn camera was when its view was taken.

    Attributes
    ----------
    pose : (4, 4) float64
        T_WF: maps points of F into W, metres.
    covariance : (6, 6) float64
        Of it over (translation, rotation), tangent on the right, m^2 and rad^2.
    measured : bool
        Whether matches of the view tell it; else it is where T_CF says, seen from the pose of Cs.
    t : float
        When that was, seconds, by the clock of Cs.
    matches : int
        Matches of the view that the filter was given.
    clock : tuple of (float, float) or None
        By how much its views are taken after their stamps, by the clock of Cs, as far as the filter
        knows, and the standard deviation of that, seconds; None where the clock is exact.
    """

    pose: Array
    covariance: Array
    measured: bool
    t: float
    matches: int
    clock: tuple[float, float] | None = None


@dataclass(frozen=True, repr=False)
class GyroEstimate(Brief):
    """What is known of a gyroscope after a frame (METHOD section 28).

    Attributes
    ----------
    bias, bias_sd : (3,) float64
        Along its axes, rad/s, and standard deviations.
    time_offset, time_offset_sd : float
        What is to be added to its stamps for those of the frames, seconds, and its standard deviation.
    followed : bool
        Whether predictions follow it; False once the images have contradicted it too often.
    """

    bias: Array
    bias_sd: Array
    time_offset: float
    time_offset_sd: float
    followed: bool


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
        OK, DEGRADED, COASTING or LOST; NOT_STARTED as long as there is no map.
    valid : bool
        Whether the pose may be used: the filter has started and is not LOST.
    started : bool
        Whether there is a map to localise in.
    metric : bool
        Whether lengths are metres; otherwise they are in a unit that the start chose, and that drifts.
    scale_sd : float
        Relative standard deviation of the scale: all distances from the camera to the map may be too long or
        too short by this share together.  Infinite where lengths are not metres, and before the start.
    pose_map, covariance_map : (4, 4), (6, 6) float64
        The same pose in the map of all submaps, as loops correct it, and its covariance.  ``pose`` and
        ``covariance`` until one is found: those never jump when an earlier place is recognised, these do.
    diagnostics : dict
        Counts, reasons of rejection, milliseconds per stage.
    worn : dict
        Where the worn cameras are whose views this frame used or looked at, by name; a `WornPose` each.
    features : FrameFeatures
        What became of each feature that should be visible; a checkpoint does not keep it.
    gyro : GyroEstimate or None
        Of the gyroscope, where there is one.
    level : Level or None
        Which way is down in W, once accelerations tell it; None until then.
    """

    t: float
    pose: Array
    covariance: Array
    status: Status
    valid: bool
    started: bool
    metric: bool
    scale_sd: float
    pose_map: Array
    covariance_map: Array
    diagnostics: dict[str, Any]
    worn: Mapping[str, WornPose] = field(default_factory=dict)
    features: FrameFeatures = field(default_factory=FrameFeatures)
    gyro: GyroEstimate | None = None
    level: Level | None = None

    def __repr__(self) -> str:
        lines = [f"StepResult at {self.t:.6f} s: {self.status.value}"]
        if self.valid:
            x, y, z = self.pose[:3, 3]
            turn = np.degrees(rotation_log(np.ascontiguousarray(self.pose[:3, :3])))
            variances = self.covariance.diagonal()
            metres, degrees = np.sqrt(variances[:3].sum()), np.degrees(np.sqrt(variances[3:].sum()))
            unit = "m" if self.metric else "units of its own"
            lines += [
                f"  position {x:.3f} {y:.3f} {z:.3f} {unit}, known to {metres:.3f} (1 sigma)",
                f"  turned by {turn[0]:.2f} {turn[1]:.2f} {turn[2]:.2f} degrees, known to {degrees:.2f}",
            ]
            lines += [f"  scale known to {100.0 * self.scale_sd:.2g} %"] if self.metric else []
        states = self.features.states
        lines.append(f"  features: {states.count('accepted')} accepted of {len(states)} expected in view")
        for name, worn in list(self.worn.items())[:3]:
            how = f"{worn.matches} matches" if worn.measured else "by T_CF alone, not by matches"
            lines.append(f"  worn camera{' ' if name else ''}{name}: {how}")
        return "\n".join(lines)

    @property
    def bound(self) -> Bound | None:
        """What the error of ``pose`` stays below; docs/consistency.md has how often it did.

        None unless ``status`` is OK and lengths are metres.
        """
        if self.status is not Status.OK or not self.metric:
            return None
        radius, angle = bounds(self.covariance[None])
        return Bound(float(radius[0]), float(angle[0]))

    @property
    def t_map_odom(self) -> Array:
        """(4, 4): what moves ``pose`` to ``pose_map``, from the world of the odometry into the map."""
        return np.asarray(self.pose_map @ pose_inverse(self.pose))


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


@dataclass(frozen=True, repr=False)
class Landmarks(Brief):
    """The map: ``ids`` (N,) int64, ``points`` (N, 3) metres in W, ``covariance`` (N, 3, 3) m^2."""

    ids: Ids
    points: Array
    covariance: Array


@dataclass(frozen=True, repr=False)
class SubmapPoses(Brief):
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

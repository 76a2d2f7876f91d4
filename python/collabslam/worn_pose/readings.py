"""What the sensors say: one scan, one attitude."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from collabslam.errors import InputError
from collabslam.types import Array

Wearer = Literal["robot", "worn"]
_UNIT = 1e-2


@dataclass(frozen=True)
class LaserScan:
    """One scan of a planar laser range finder, as in ROS's ``sensor_msgs/LaserScan``.

    Attributes
    ----------
    t : float
        Instant of the first beam, seconds.
    ranges : (K,) array
        Metres. More than ``range_max``, as a rule infinite, where a beam met nothing up to there; NaN or less
        than ``range_min`` where it tells nothing.
    angle_min, angle_increment : float
        Of the beams, radians about the scanner's z axis (up), from its x axis (ahead) towards y (left).
    scanner : str
        Which one: a name in `WornPoseConfig.scanners`.
    range_min, range_max : float
        Limits, metres.
    time_increment : float
        Seconds from beam to beam; 0 if all are taken at once.

    Raises
    ------
    InputError
        If the shape is wrong or a number is not possible.
    """

    t: float
    ranges: Array = field(repr=False)
    angle_min: float
    angle_increment: float
    scanner: str = "front"
    range_min: float = 0.3
    range_max: float = 20.0
    time_increment: float = 0.0

    def __post_init__(self) -> None:
        ranges = np.asarray(self.ranges, dtype=np.float64)
        object.__setattr__(self, "ranges", ranges)
        if ranges.ndim != 1 or len(ranges) < 3:
            raise InputError(f"The scan's ranges have the shape {ranges.shape}; give (K,), 3 beams or more.")
        numbers = (self.t, self.angle_min, self.angle_increment, self.range_min, self.range_max)
        if not np.isfinite([*numbers, self.time_increment]).all():
            raise InputError("The scan's stamp, angles or limits are not finite; give finite numbers.")
        if self.angle_increment == 0.0 or abs(self.angle_increment) * (len(ranges) - 1) > 2.01 * np.pi:
            raise InputError(
                f"The scan's angle_increment is {self.angle_increment} rad for {len(ranges)} beams; give "
                "radians, not zero, and at most a full turn."
            )
        if not 0.0 <= self.range_min < self.range_max:
            raise InputError(
                f"The scan's limits are {self.range_min} to {self.range_max} m; give 0 <= least < largest."
            )


@dataclass(frozen=True)
class AhrsReading:
    """One attitude of an AHRS, as in ROS's ``sensor_msgs/Imu``.

    Attributes
    ----------
    t : float
        Seconds.
    q_xyzw : (4,) array
        Unit quaternion, **scalar last as in ROS**: turns the sensor's axes into N, whose z axis is up and
        whose heading (north, or any other) is the same for both AHRSs.
    where : {"robot", "worn"}
        Which AHRS: on the robot, or on the worn camera.

    Raises
    ------
    InputError
        If the quaternion is not a unit one, or a number is not finite.
    """

    t: float
    q_xyzw: Array
    where: Wearer

    def __post_init__(self) -> None:
        q = np.asarray(self.q_xyzw, dtype=np.float64)
        object.__setattr__(self, "q_xyzw", q)
        if q.shape != (4,):
            raise InputError(f"The AHRS's quaternion has the shape {q.shape}; give (4,): x, y, z, w.")
        if not abs(float(q @ q) - 1.0) < 2.0 * _UNIT:
            raise InputError(
                f"The AHRS's quaternion {q.tolist()} is not a unit one; give x, y, z, w of norm 1."
            )
        if not np.isfinite(self.t):
            raise InputError(f"The AHRS's stamp is {self.t}; give seconds.")
        if self.where not in ("robot", "worn"):
            raise InputError(f"There is no AHRS '{self.where}'; there are 'robot' and 'worn'.")


@dataclass(frozen=True)
class Diagnostics:
    """What stands behind an estimate.

    Attributes
    ----------
    state : {"searching", "tracked", "bridged", "lost"}
        No person found yet; seen in the last scans; predicted over a gap; lost after one.
    since_seen : float
        Seconds since the legs were last seen; infinite before.
    position_sd : float
        Of the legs' centre along its worst horizontal axis, metres.
    speed : float
        Of the person over the floor, m/s.
    candidates : int
        Leg-like things in the last scan that are not part of the known surroundings.
    others : int
        Other things that move and are tracked, so that they are not taken for the person.
    scans : int
        Scans used so far.
    """

    state: str
    since_seen: float
    position_sd: float
    speed: float
    candidates: int
    others: int
    scans: int


@dataclass(frozen=True)
class WornPoseEstimate:
    """Pose of the worn camera at an instant, or why there is none.

    Attributes
    ----------
    t : float
        Seconds.
    t_cf : (4, 4) array or None
        Maps points of F into C, metres.
    covariance : (6, 6) array or None
        Of ``t_cf`` over (translation, rotation), tangent on the right, T = T_hat Exp(xi); m^2 and rad^2.
    bias : (6, 6) array or None
        The part of the covariance that stays from frame to frame: the person's build and bearing, and the
        slow errors of the AHRSs, whose heading drifts with ``AhrsErrors.drift_time``.
    reason : str or None
        Why there is no pose.
    diagnostics : Diagnostics
    trunk : (3, 3) array or None
        Turns the axes of the person's trunk (ahead, left, up) into C's; None without a pose.
    swing : (2,) array or None
        How far the middle of both shins swings ahead of the trunk, and its rate over 2 pi
        ``Person.step_rate``, metres; None without a pose.
    """

    t: float
    t_cf: Array | None
    covariance: Array | None
    bias: Array | None
    reason: str | None
    diagnostics: Diagnostics
    trunk: Array | None = None
    swing: Array | None = None

    @property
    def bias_share(self) -> float:
        """Share of the variance that is bias, averaged over the six axes: the filter's
        ``worn.bias_share``; NaN without a pose."""
        if self.covariance is None or self.bias is None:
            return float("nan")
        return float(np.mean(np.diag(self.bias) / np.diag(self.covariance)))

"""Where the sensors sit, who wears the camera, and how large the errors are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np

from collabslam.errors import InputError
from collabslam.geometry import is_rotation
from collabslam.types import Array

AHEAD_LEFT_UP = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Turns axes x ahead, y left, z up (ROS's bodies, scanners and AHRSs) into a camera's that looks ahead."""


def scanner_pose(ahead: float, left: float, up: float, heading: float = 0.0) -> Array:
    """``t_c_scanner`` (4, 4) of a level scanner, seen from a level Cs.

    Parameters
    ----------
    ahead, left, up : float
        Of Cs, metres: a scanner near the floor has a negative ``up``.
    heading : float
        Of its x axis from Cs's line of sight, radians to the left; pi for one that looks back.
    """
    c, s = np.cos(heading), np.sin(heading)
    out = np.eye(4)
    out[:3, :3] = AHEAD_LEFT_UP @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    out[:3, 3] = (-left, -up, ahead)
    return out


def _front_and_back() -> dict[str, Array]:
    return {
        "front": scanner_pose(0.05, 0.0, -0.65),
        "back": scanner_pose(-0.45, 0.0, -0.65, float(np.pi)),
    }


@dataclass(frozen=True)
class Person:
    """Who wears the camera.

    Attributes
    ----------
    camera_height : float
        Of Cf above the floor, standing upright and looking ahead, metres.
    neck_to_camera : (3,) array
        From the point about which the head turns to Cf, along F's axes (right, down, ahead), metres.
    lean : (2,) tuple
        Of the neck before, and left of, the legs' centre, metres.
    height_sd, lever_sd : float
        Of what stays for the whole walk: of that height, and of the neck over the legs' centre along each
        horizontal axis (build, lean, how the camera is fastened), metres.
    surge, bob : (2,) tuple
        Motion of the head with the steps, ahead and up: metres for each metre by which the middle of both
        shins swings ahead of the trunk, and for each metre of that swing's rate over 2 pi ``step_rate``.
    bob_sd, sway_sd : float
        Of what else each step does to the head, up and down and along each horizontal axis, walking at
        1.3 m/s, metres; they are in proportion to the speed.
    leg_radius : float
        Of a shin with its trouser leg, metres.
    acceleration_density : float
        Of the walk over the floor, m/s^1.5: 0.6 is a corner of 1.3 m taken at 1.3 m/s, or a stop.
    gait_sd, step_rate : float
        The middle of both shins swings about the trunk (while both feet are on the floor it stands still):
        metres along the way at 1.3 m/s, in proportion to the speed, and steps a second.
    one_leg_sd : float
        Of the trunk about one shin along each axis, metres.
    """

    camera_height: float = 1.70
    neck_to_camera: tuple[float, float, float] = (0.0, -0.10, 0.10)
    lean: tuple[float, float] = (0.0, 0.0)
    surge: tuple[float, float] = (0.0, 0.0)
    bob: tuple[float, float] = (0.0, 0.0)
    height_sd: float = 0.02
    lever_sd: float = 0.03
    bob_sd: float = 0.016
    sway_sd: float = 0.016
    leg_radius: float = 0.06
    acceleration_density: float = 0.6
    gait_sd: float = 0.055
    step_rate: float = 1.8
    one_leg_sd: float = 0.15


@dataclass(frozen=True)
class AhrsErrors:
    """Standard deviations of an AHRS's attitude (Table C1), and how they change in time.

    The heading's error is a Gauss-Markov bias (standard deviation sqrt(yaw_sd^2 - yaw_white_sd^2), time
    constant ``drift_time``) plus white noise; so is the tilt's.  It is about the vertical, and the tilt about
    the horizontal axes: for an upright camera that is yaw about y, roll about z, pitch about x (METHOD 11).

    Attributes
    ----------
    tilt_sd, yaw_sd : float
        Whole error: of roll and pitch, and of the heading, radians.
    tilt_white_sd, yaw_white_sd : float
        The part that is new in every reading, radians.
    drift_time : float
        Time constant of the rest, seconds.
    """

    tilt_sd: float = float(np.radians(0.5))
    yaw_sd: float = float(np.radians(1.0))
    tilt_white_sd: float = float(np.radians(0.2))
    yaw_white_sd: float = float(np.radians(0.2))
    drift_time: float = 60.0


@dataclass(frozen=True)
class WornPoseConfig:
    """Everything that `WornPoseEstimator` is told once.

    Attributes
    ----------
    scanners : mapping of str to (4, 4) array
        ``t_c_scanner`` of each scanner by name: maps its points into C; see `scanner_pose`.
    r_c_ahrs, r_f_ahrs : (3, 3) array
        Turn the axes of the robot's AHRS into C's, and those of the worn one into F's.
    camera_height : float
        Of Cs above the floor, metres.
    person : Person
    ahrs : AhrsErrors
        Of both.
    level_sd : float or None
        How far Cs is from level where the robot drives, about each horizontal axis, radians: a floor
        indoors, a stiff mount and the shake of driving make about 0.005.  None where the ground may be
        anything: then its AHRS alone says.
    range_sd : float
        Noise of a range, metres.
    start : (2,) tuple or None
        Where the person stands at the start, if that is known: right and ahead of Cs, metres, to half a
        metre.  Without it, or if something else there may as well be their legs, the person is found when
        they first move.
    max_gap : float
        Longest gap that is bridged, seconds.
    max_position_sd : float
        Largest standard deviation of a position that is handed out, metres.
    max_ahrs_age : float
        Longest time over which an attitude is extrapolated, seconds.
    history : float
        How far back `WornPoseEstimator.pose_at` may be asked, seconds.

    Raises
    ------
    InputError
        Naming the value that is not possible.
    """

    scanners: Mapping[str, Array] = field(default_factory=_front_and_back)
    r_c_ahrs: Array = field(default_factory=AHEAD_LEFT_UP.copy)
    r_f_ahrs: Array = field(default_factory=AHEAD_LEFT_UP.copy)
    camera_height: float = 0.95
    person: Person = field(default_factory=Person)
    ahrs: AhrsErrors = field(default_factory=AhrsErrors)
    level_sd: float | None = None
    range_sd: float = 0.02
    start: tuple[float, float] | None = None
    max_gap: float = 2.5
    max_position_sd: float = 0.35
    max_ahrs_age: float = 0.1
    history: float = 10.0

    @property
    def tilt_share(self) -> float:
        """Share of the tilt that the robot's AHRS reads which is believed."""
        return 1.0 if self.level_sd is None else self.level_sd**2 / (self.level_sd**2 + self.ahrs.tilt_sd**2)

    @property
    def robot_tilt(self) -> tuple[float, float]:
        """Variances of what then is wrong with the tilt of Cs, about each horizontal axis: of the part that
        lasts, and of what is new in every reading, the shake included; rad^2."""
        share, ahrs = self.tilt_share, self.ahrs
        time_correlated = share**2 * (ahrs.tilt_sd**2 - ahrs.tilt_white_sd**2)
        return time_correlated, share * ahrs.tilt_sd**2 - time_correlated

    def __post_init__(self) -> None:
        if not self.scanners:
            raise InputError("The sensors have no scanner; give t_c_scanner of one or more.")
        for name, pose in self.scanners.items():
            if np.shape(pose) != (4, 4) or not is_rotation(np.asarray(pose)[:3, :3]):
                raise InputError(f"t_c_scanner of '{name}' is not a pose; give a 4x4 of a rigid motion.")
        for what, turn in (("r_c_ahrs", self.r_c_ahrs), ("r_f_ahrs", self.r_f_ahrs)):
            if not is_rotation(turn):
                raise InputError(f"{what} is not a rotation; give a 3x3 that turns the AHRS's axes.")
        for name, these in (
            ("lean", "ahead and left in metres"),
            ("surge", "them by swing, and by its rate"),
            ("bob", "them by swing, and by its rate"),
        ):
            value = getattr(self.person, name)
            if np.shape(value) != (2,) or not np.isfinite(value).all():
                raise InputError(f"{name} is not two finite numbers; give {these}.")
        if np.shape(self.person.neck_to_camera) != (3,) or not np.isfinite(self.person.neck_to_camera).all():
            raise InputError("neck_to_camera is not three finite numbers; give right, down, ahead in metres.")
        if self.start is not None and (np.shape(self.start) != (2,) or not np.isfinite(self.start).all()):
            raise InputError("start is not two finite numbers; give metres right and ahead of Cs.")
        for part in (self, self.person, self.ahrs):
            for f in fields(part):
                value = getattr(part, f.name)
                if isinstance(value, (int, float)) and not (np.isfinite(value) and value > 0.0):
                    raise InputError(f"{f.name} is {value}; give a positive number.")
        if self.ahrs.tilt_white_sd > self.ahrs.tilt_sd or self.ahrs.yaw_white_sd > self.ahrs.yaw_sd:
            raise InputError("The white part of an AHRS's error is larger than the whole; make it smaller.")

"""The values that pass between recordings, the engine and the results.

Frames: W world, C robot camera Cs, F worn camera Cf (METHOD section 1).  ``t_ab`` maps points of B into A.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from collabslam._core import Camera
from collabslam.errors import CollabslamError, InputError

PERSON = "[A-Za-z0-9_][A-Za-z0-9_-]{0,31}"
"""What a person may be called."""
Image = NDArray[np.uint8]
Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ids = NDArray[np.int64]
Indices = NDArray[np.int64]


class Brief:
    """Prints as a line: what holds arrays prints them by their shapes."""

    def __repr__(self) -> str:
        told = ", ".join(f"{name}={_brief(value)}" for name, value in vars(self).items())
        return f"{type(self).__name__}({told})"


def _brief(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape}"
    if isinstance(value, list | tuple | dict) and len(value) > 4:
        return f"{len(value)} in a {type(value).__name__}"
    return repr(value)


def person_name(name: object, error: type[CollabslamError]) -> str:
    """``name`` if a person can be called so; raises ``error`` otherwise.

    Folders, topics and result files are named after it.
    """
    if not isinstance(name, str) or not re.fullmatch(PERSON, name):
        raise error(
            f"A person cannot be called {str(name)[:80]!r}; take up to 32 letters, digits, _ and -, and no - "
            "at first."
        )
    return name


class Status(str, enum.Enum):
    """What the filter can say of its own pose."""

    OK = "OK"
    DEGRADED = "DEGRADED"
    COASTING = "COASTING"
    NOT_STARTED = "NOT_STARTED"
    LOST = "LOST"


@dataclass(frozen=True, repr=False)
class WornView(Brief):
    """One view of a worn camera Cf.

    Attributes
    ----------
    image : (H, W) uint8
    t_cf : (4, 4) float64
        Measured pose of Cf relative to Cs when the view was taken: maps points of F into C, metres.
    covariance : (6, 6) float64
        Of ``t_cf`` over (translation, rotation), tangent on the right, m^2 and rad^2.
    bias : (6, 6) float64 or None
        The part of ``covariance`` that lasts from frame to frame (METHOD section 6), with the time constant
        ``worn.bias_time``; None if that is not known: then it is the share ``worn.bias_share``.
    t : float or None
        When it was taken, seconds, by the clock of Cs's time stamps: between two frames, or up to
        ``worn.late`` before the one that it comes with (METHOD section 21); None if at the frame's instant.
    who : str
        Which worn camera it is of, where there are several.
    body : bool
        Whether somebody wears it, whose body Cs may see below it: not so of one that is emulated, or that is
        bound to Cs.
    rate : (3,) float64 or None
        Angular velocity of Cf when the middle row was taken, rad/s along the axes of F, as a gyroscope of its
        own tells it: how its rolling shutter turned (METHOD section 6). None if nothing tells it.
    """

    image: Image
    t_cf: Array
    covariance: Array
    bias: Array | None = None
    t: float | None = None
    who: str = ""
    body: bool = True
    rate: Array | None = None


@dataclass(frozen=True, repr=False)
class Masks(Brief):
    """What is never scene in the cameras' images; True where there may be scene.

    Attributes
    ----------
    robot : (H, W) bool or None
        Of Cs; None where all may be scene.
    worn : mapping of (H, W) bool
        Of worn cameras that have one, by name.
    """

    robot: Mask | None = None
    worn: Mapping[str, Mask] = field(default_factory=dict)

    @property
    def any(self) -> bool:
        """Whether there is one."""
        return self.robot is not None or bool(self.worn)


@dataclass(frozen=True, repr=False)
class DepthPoints(Brief):
    """What another sensor measured of the depth in a frame.

    Attributes
    ----------
    uv : (N, 2) float64
        Pixels of Cs.
    depth, sigma : (N,) float64
        Along the optical axis of Cs, and its standard deviation, metres.
    """

    uv: Array
    depth: Array
    sigma: Array


@dataclass(frozen=True, repr=False)
class Odometry(Brief):
    """What wheels or another sensor of motion measured beside a recording (METHOD section 23).

    Attributes
    ----------
    times : (N,) float64
        Stamps, seconds, increasing, by the clock of Cs.
    twists : (N, 6) float64
        Mean velocity and angular velocity of the odometry's frame B since the sample before, along the axes
        of B, m/s and rad/s.
    covariances : (N, 6, 6) float64
        Of them, as independent from sample to sample; positive definite.
    t_bc : (4, 4) float64
        Where Cs sits: maps points of C into B, metres.
    """

    times: Array
    twists: Array
    covariances: Array
    t_bc: Array

    def __len__(self) -> int:
        return len(self.times)


@dataclass(frozen=True, repr=False)
class Imu(Brief):
    """A gyroscope, and maybe an accelerometer, that is fixed to Cs: how it sits, and how good it is.

    What is None is the setting ``filter.imu`` of that name.

    Attributes
    ----------
    r_ci : (3, 3) float64
        Maps the axes of the sensor I into those of C.
    mount_sd : float or None
        Standard deviation of each of the three angles of ``r_ci``, rad.
    gyro_noise : float or None
        Density of the rates' white noise, rad/s/sqrt(Hz).
    gyro_bias_sd : float or None
        Standard deviation of the bias at the start, rad/s.
    gyro_bias_walk : float or None
        How the bias walks, rad/s/sqrt(s).
    gyro_scale_sd : float or None
        Standard deviation of the relative error of the scale.
    time_offset : float
        Seconds that are added to the sensor's stamps to be on the clock of the frames.
    time_offset_sd : float or None
        Standard deviation of that, seconds.
    accel_noise : float or None
        Density of the accelerations' white noise, m/s^2/sqrt(Hz).
    accel_bias_sd : float or None
        Standard deviation of the accelerations' bias, m/s^2.
    """

    r_ci: Array = field(default_factory=lambda: np.eye(3))
    mount_sd: float | None = None
    gyro_noise: float | None = None
    gyro_bias_sd: float | None = None
    gyro_bias_walk: float | None = None
    gyro_scale_sd: float | None = None
    time_offset: float = 0.0
    time_offset_sd: float | None = None
    accel_noise: float | None = None
    accel_bias_sd: float | None = None

    @property
    def sizes(self) -> dict[str, float]:
        """What is stated of its errors, by the keys of the settings."""
        names = (f.name for f in fields(self) if f.name not in ("r_ci", "time_offset"))
        stated = {f"filter.imu.{name}": getattr(self, name) for name in names}
        try:
            return {key: float(value) for key, value in stated.items() if value is not None}
        except (TypeError, ValueError) as error:
            raise InputError(f"A size of the gyroscope's errors is no number ({error}).") from error


@dataclass(frozen=True, repr=False)
class ImuLog(Brief):
    """What a gyroscope, and maybe an accelerometer, measured beside a recording (METHOD section 28).

    Attributes
    ----------
    times : (N,) float64
        Stamps, seconds, increasing, by the sensor's own clock; ``sensor.time_offset`` is added to be on that
        of the frames.
    rates : (N, 3) float64
        Angular velocity along the sensor's axes I, rad/s.
    accelerations : (N, 3) float64 or None
        Specific force along the axes of I, m/s^2, NaN where a sample has none: at rest it points up with 9.8.
    sensor : Imu
        How it sits and how good it is.
    left_out : int
        Samples of the source that are not in it, as they cannot be used.
    """

    times: Array
    rates: Array
    accelerations: Array | None
    sensor: Imu
    left_out: int = 0

    def __len__(self) -> int:
        return len(self.times)


@dataclass(frozen=True, repr=False)
class Frame(Brief):
    """One frame of a recording.

    Attributes
    ----------
    index : int
        Position in the recording, from 0.
    t : float
        Time stamp, seconds.
    image : (H, W) uint8
        Grey image of Cs.
    views : tuple of WornView
        Of the worn cameras: at most one of each, none where nobody's has come.
    depth : DepthPoints or None
        Depths, where there are some.
    """

    index: int
    t: float
    image: Image
    views: tuple[WornView, ...] = ()
    depth: DepthPoints | None = None


@dataclass(frozen=True, repr=False)
class Target(Brief):
    """A known metric target in the first frame (METHOD section 10).

    Attributes
    ----------
    points : (N, 3) float64
        Points in the target's frame, metres.
    patches : sequence of (h, w) uint8
        One patch of each point, as the camera sees it from the start pose.
    t_tc : (4, 4) float64
        Approximate start pose: maps points of C into the target's frame.
    covariance : (6, 6) float64
        Of ``t_tc`` over (translation, rotation), tangent on the right, m^2 and rad^2.
    """

    points: Array
    patches: Sequence[Image]
    t_tc: Array
    covariance: Array


class Recording(Protocol):
    """What every data set is to the rest of the package.

    Attributes
    ----------
    name : str
        Short name, used in results.
    source : str
        Where the recording was read from.
    camera : Camera
        Calibration of Cs.
    worn_camera : Camera or None
        Calibration of Cf; of the first one where several persons wear a camera (see
        `worn_cameras`).
    times : (N,) float64
        Time stamps, seconds, strictly increasing if `open_recording` has opened it; a run leaves out those
        that are not.
    truth : (N, 4, 4) float64 or None
        True ``T_WC`` of Cs in the data set's own world; NaN where it is missing.  Never used by the filter.
    target : Target or None
    """

    @property
    def name(self) -> str: ...
    @property
    def source(self) -> str: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def worn_camera(self) -> Camera | None: ...
    @property
    def times(self) -> Array: ...
    @property
    def truth(self) -> Array | None: ...
    @property
    def target(self) -> Target | None: ...

    def __len__(self) -> int: ...

    def frame(self, i: int) -> Frame:
        """Frame ``i``; raises DataError naming the file if it is missing, broken or of the wrong size."""
        ...

    def image(self, i: int) -> Image:
        """The (H, W) uint8 image of Cs in frame ``i``."""
        ...


def worn_cameras(recording: Recording) -> dict[str, Camera]:
    """Calibration of each worn camera of a recording, by the name of whoever wears it.

    That of a single one without a name is ""; empty if there is none.  `collabslam.Slam` takes it as it is.
    """
    named: dict[str, Camera] | None = getattr(recording, "worn_cameras", None)
    if named is not None:
        return dict(named)
    return {} if recording.worn_camera is None else {"": recording.worn_camera}


def masks_of(recording: Recording) -> Masks:
    """What is never scene in a recording's images."""
    masks: Masks = getattr(recording, "masks", Masks())
    return masks

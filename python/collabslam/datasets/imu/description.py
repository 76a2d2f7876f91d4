"""How an inertial sensor sits and how good it is: which keys of which program's files mean what.

Read are Kalibr's ``imu.yaml`` and ``camchain-imucam.yaml``, EuRoC's ``sensor.yaml``, ORB-SLAM3's settings,
and our own ``imu.yaml``, which has Kalibr's keys and more::

    gyroscope_noise_density: 0.001     # rad/s/sqrt(Hz); gyro_noise of `collabslam.Imu`
    gyroscope_random_walk: 0.0001      # rad/s^2/sqrt(Hz); gyro_bias_walk
    accelerometer_noise_density: 0.01  # m/s^2/sqrt(Hz); accel_noise
    axes: optical                      # or opengl, ros, phone-left, phone-right: what its axes are
    T_cam_imu: [..16 numbers..]        # in place of axes: maps points of the sensor I into C
    timeshift_cam_imu: 0.003           # seconds: stamps of I are those of the frames plus this
    mount_sd_deg: 0.5                  # of the three angles of the mount
    gyro_bias_sd: 0.01                 # rad/s
    gyro_scale_sd: 0.01
    time_offset_sd: 0.005              # seconds
    accel_bias_sd: 0.1                 # m/s^2

What a file does not say is the setting's default.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from collabslam.datasets.gate import Keys, has_keys, read_keys, tell
from collabslam.datasets.poses import AXES, rigid
from collabslam.errors import DataError
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Imu

MOUNTS: dict[str, Array] = {
    **{name: np.asarray(axes[:3, :3].T) for name, axes in AXES.items()},
    "phone-left": np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "phone-right": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
}
"""R_CI of axes by name.  A phone's are x right, y up, z out of its screen: upright they are OpenGL's; left
and right are where its top points while it films wide pictures, as whoever holds it sees it."""
_NOISES = {
    "gyro_noise": ("gyroscope_noise_density", "IMU.NoiseGyro"),
    "gyro_bias_walk": ("gyroscope_random_walk", "IMU.GyroWalk"),
    "accel_noise": ("accelerometer_noise_density", "IMU.NoiseAcc"),
}
_OWN = ("gyro_bias_sd", "gyro_scale_sd", "time_offset_sd", "accel_bias_sd")
_SD_DEG = "mount_sd_deg"
_T_CI, _T_IC = ("T_cam_imu",), ("T_imu_cam", "IMU.T_b_c1", "Tbc")
_SHIFT = "timeshift_cam_imu"
_SAYS_NOTHING = (
    "comment*", "sensor_type", "rate_hz", "update_rate", "rostopic", "accelerometer_random_walk", "model",
    "T_i_b", "time_offset", "IMU.AccWalk", "IMU.Frequency", "IMU.InsertKFsWhenLost", "topic", "n*frames*",
)  # fmt: skip
_MOST_NOISE, _MOST_SHIFT = 1.0, 10.0
_DECIMALS = 12
"""Of a rotation that is written: read back and made orthonormal it comes out the same when written again."""
_STRAIGHT = 0.05
"""By how much a gyroscope's own matrix of scales and skews may differ from none."""


@dataclass(frozen=True)
class ImuFile:
    """What files say of an inertial sensor.

    Attributes
    ----------
    numbers : dict
        Fields of `collabslam.Imu`, but for its mount.
    r_ci : (3, 3) float64 or None
        Maps axes of I into C.
    t_bs : (4, 4) float64 or None
        EuRoC's: maps points of I into the body, in which the camera's own ``T_BS`` is told.
    """

    numbers: dict[str, float] = field(default_factory=dict)
    r_ci: Array | None = None
    t_bs: Array | None = None

    def over(self, other: ImuFile) -> ImuFile:
        """This, and what ``other`` says where this says nothing."""
        if self.r_ci is not None or self.t_bs is not None:
            other = replace(other, r_ci=None, t_bs=None)
        r_ci = other.r_ci if self.r_ci is None else self.r_ci
        t_bs = other.t_bs if self.t_bs is None else self.t_bs
        return ImuFile({**other.numbers, **self.numbers}, r_ci, t_bs)

    def sensor(self, r_ci: Array) -> Imu:
        """The sensor with this mount (3, 3)."""
        return Imu(r_ci=np.asarray(r_ci, np.float64), **self.numbers)


def read_imu_file(path: Path) -> ImuFile:
    """What a file says of an inertial sensor; all its keys are used, or passed over by name.

    Raises
    ------
    DataError
        Naming the key that is not known, or whose value cannot be.
    """
    with read_keys(path) as keys:
        cameras = sorted(key for key in keys if re.fullmatch(r"cam\d+", key))
        if cameras:
            return _of_camchain(keys, cameras)
        if keys.has("imu0"):
            keys.leave("imu[1-9]*", why="other sensors than imu0")
            with keys.inside("imu0") as block:
                return _of_keys(block)
        return _of_keys(keys)


def of_camera_file(path: Path) -> ImuFile:
    """What the calibration of Cs says of the sensor beside it: the mount and clock of a camchain-imucam."""
    if not has_keys(path):
        return ImuFile()
    keys = read_keys(path)
    cameras = sorted(key for key in keys if re.fullmatch(r"cam\d+", key))
    told = [c for c in cameras if {*_T_CI, *_T_IC} & set(keys.peek(c))]
    if not told:
        return ImuFile()  # a calibration of the lens alone, which its own reader checks
    with keys:
        found = _of_camchain(keys, cameras)
        keys.leave("*", why="of the lens")
    return found


def check_mount(matrix: Array, where: str) -> Array:
    """A rotation (3, 3), orthonormal; raises DataError if it is none, as one that mirrors."""
    pose = np.eye(4)
    pose[:3, :3] = matrix
    found: Array = rigid(pose, where)[:3, :3]
    return found


def _of_keys(keys: Keys) -> ImuFile:
    numbers = {}
    for name, known in _NOISES.items():
        if keys.has(*known):
            numbers[name] = _positive(keys, known, _MOST_NOISE if name.startswith("gyro") else 100.0)
    for name in _OWN:
        if keys.has(name):
            numbers[name] = _positive(keys, (name,), _MOST_SHIFT, zero=True)
    if keys.has(_SD_DEG):
        numbers["mount_sd"] = math.radians(_positive(keys, (_SD_DEG,), 180.0, zero=True))
    r_ci, shift = _mount(keys)
    t_bs = None
    if keys.has("T_BS"):
        t_bs = rigid(np.asarray(keys.numbers("T_BS", count=(16,))).reshape(4, 4), f"T_BS of {keys.where}")
    turn = _gyroscopes(keys)
    if r_ci is not None and turn is not None:
        r_ci = r_ci @ turn
    if "IMU" in {key.split(".")[0] for key in keys}:
        keys.leave("[!I]*", "Camera*", why="settings of ORB-SLAM, not of the sensor")
    keys.leave(*_SAYS_NOTHING)
    return ImuFile(numbers | shift, r_ci, t_bs)


def _of_camchain(keys: Keys, cameras: list[str]) -> ImuFile:
    """The mount and clock that a camchain tells of its first camera, which is Cs."""
    with keys.inside(cameras[0]) as block:
        r_ci, shift = _mount(block)
        block.leave("*", why="of the lens")
    keys.leave(*cameras, why=f"other cameras than {cameras[0]}")
    if r_ci is None:
        raise DataError(
            f"{keys.where} does not say how the sensor sits ('T_cam_imu'); give the camchain-imucam that "
            "Kalibr writes when it calibrates camera and IMU."
        )
    return ImuFile(shift, r_ci)


def _mount(keys: Keys) -> tuple[Array | None, dict[str, float]]:
    """R_CI where the keys tell it, and the time offset where they tell that."""
    r_ci = None
    for names, inverse in ((_T_CI, False), (_T_IC, True)):
        if keys.has(*names):
            pose = np.asarray(keys.numbers(*names, count=(16,))).reshape(4, 4)
            pose = rigid(pose, f"{names[0]} of {keys.where}")
            r_ci = (pose_inverse(pose) if inverse else pose)[:3, :3]
    if keys.has("axes"):
        r_ci = _of_axes(keys, r_ci)
    if not keys.has(_SHIFT):
        return r_ci, {}
    shift = keys.number(_SHIFT)
    if abs(shift) > _MOST_SHIFT:
        raise DataError(
            f"The key '{_SHIFT}' of {keys.where} is {shift:g} s, more than {_MOST_SHIFT:g}; give seconds, or "
            "put camera and sensor on one clock."
        )
    return r_ci, {"time_offset": -shift}  # Kalibr: t_imu = t_cam + shift


def _of_axes(keys: Keys, other: Array | None) -> Array:
    name = str(keys.take("axes"))
    if name not in MOUNTS:
        raise DataError(f"{keys.where} has no such axes as '{name}'; give one of {', '.join(MOUNTS)}.")
    if other is not None:
        raise DataError(f"{keys.where} has both T_cam_imu and axes; leave out one of them.")
    return MOUNTS[name]


def _gyroscopes(keys: Keys) -> Array | None:
    """How the gyroscope is turned in the sensor (R_I_gyro), of Kalibr's larger models; None if not told."""
    keys.leave("accelerometers", "Ta", "Tg", "R_IMUtoACC", why="of the accelerometer")
    turn = None
    if keys.has("R_IMUtoGYRO"):
        turn = np.asarray(keys.numbers("R_IMUtoGYRO", count=(9,))).reshape(3, 3).T
    straight = [keys.numbers("Tw", count=(9,))] if keys.has("Tw") else []
    with keys.inside("gyroscopes") as block:
        if block.has("C_gyro_i"):
            turn = np.asarray(block.numbers("C_gyro_i", count=(9,))).reshape(3, 3).T
        if block.has("M"):
            straight.append(block.numbers("M", count=(9,)))
        block.leave("A", why="how acceleration disturbs the rate")
    if any(np.abs(np.reshape(m, (3, 3)) - np.eye(3)).max() > _STRAIGHT for m in straight):
        raise DataError(
            f"{keys.where} scales or skews the gyroscope by more than {100 * _STRAIGHT:g} %, which is not "
            "undone here; correct the samples with its matrix, and leave it out."
        )
    if straight:
        tell("passed over", "the gyroscope's matrix of scales (gyro_scale_sd stands for it)", keys.where)
    return None if turn is None else check_mount(turn, f"The gyroscope's rotation in {keys.where}")


def _positive(keys: Keys, names: tuple[str, ...], most: float, *, zero: bool = False) -> float:
    value = keys.number(*names)
    if not (value > 0.0 or (zero and value == 0.0)) or value > most:
        which = next(filter(keys.has, names))
        raise DataError(
            f"The key '{which}' of {keys.where} is {value:g}; give a positive number of at most {most:g}, in "
            "radians, metres and seconds."
        )
    return value


def mapping(sensor: Imu) -> dict[str, object]:
    """Content of an ``imu.yaml`` that reads back as this sensor."""
    pose = np.eye(4)
    pose[:3, :3] = sensor.r_ci
    out: dict[str, object] = {
        "sensor_type": "imu",
        "T_cam_imu": [round(float(x), _DECIMALS) + 0.0 for x in pose.ravel()],
    }
    out[_SHIFT] = 0.0 - float(sensor.time_offset)
    for name, known in _NOISES.items():
        if getattr(sensor, name) is not None:
            out[known[0]] = float(getattr(sensor, name))
    if sensor.mount_sd is not None:
        out[_SD_DEG] = math.degrees(sensor.mount_sd)
    out |= {name: float(getattr(sensor, name)) for name in _OWN if getattr(sensor, name) is not None}
    return out

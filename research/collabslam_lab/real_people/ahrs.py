"""A real inertial unit: how far a well-kept AHRS library errs, and what the attitude track adds to it.

A recording is a ``.mat`` file of the BROAD benchmark: ``imu_gyr``, ``imu_acc``, ``imu_mag`` (N, 3),
``opt_quat`` (N, 4) w x y z in a fixed frame, ``movement`` (N, 1) and ``sampling_rate``.  The library is vqf.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collabslam.errors import DataError, InputError
from collabslam.geometry import rotation_from_quaternion, rotation_log
from collabslam.types import Array
from collabslam.worn_pose import AhrsReading
from collabslam.worn_pose.attitude import AttitudeTrack

RATE = 100.0
"""Readings a second that the attitude track is given."""
AHEAD = 0.02
"""Seconds after its last reading for which it is asked."""
_ASKED_EVERY = 0.25


@dataclass(frozen=True)
class AhrsErrors:
    """RMS errors while the unit moves, degrees.

    Attributes
    ----------
    tilt, heading : float
        Of the library's attitude; of the heading about its own mean, as north is another one.
    carried : float
        By which the track's attitude differs from the library's, `AHEAD` of the last reading.
    """

    tilt: float
    heading: float
    carried: float


def judge(path: Path) -> AhrsErrors:
    """Run the library and the track over a recording.

    Raises
    ------
    DataError
        If the file is not such a recording.
    InputError
        If vqf is not installed.
    """
    try:
        from vqf import VQF
    except ImportError as error:
        raise InputError("The AHRS library vqf is not installed; pip install vqf.") from error
    from scipy.io import loadmat

    try:
        content = loadmat(path)
        names = ("imu_gyr", "imu_acc", "imu_mag", "opt_quat")
        gyr, acc, mag, true = (np.ascontiguousarray(content[n], np.float64) for n in names)
        moves = np.ravel(content["movement"]).astype(bool)
        period = 1.0 / float(np.ravel(content["sampling_rate"])[0])
    except (OSError, KeyError, ValueError, NotImplementedError, ZeroDivisionError) as error:
        raise DataError(f"The file {path} is not a recording of an inertial unit ({error}).") from error
    found = np.asarray(VQF(period).updateBatch(gyr, acc, mag)["quat9D"], np.float64)
    good = moves & np.isfinite(true).all(axis=1)
    w, _, _, z = _times(found[good], true[good] * [1.0, -1.0, -1.0, -1.0]).T
    tilt = 2.0 * np.arccos(np.clip(np.hypot(w, z), 0.0, 1.0))
    heading = np.exp(2j * np.arctan2(z, w))
    off = np.angle(heading / heading.mean())
    carried = _carried(found, period, moves)
    return AhrsErrors(*(float(np.degrees(np.sqrt(np.mean(np.square(e))))) for e in (tilt, off, carried)))


def _carried(attitude: Array, period: float, moves: Array) -> Array:
    """Angles between the track's attitude, ahead of its last reading, and the one that came, radians."""
    step, ahead = max(1, round(1.0 / (RATE * period))), round(AHEAD / period)
    track = AttitudeTrack("test", np.eye(3), 0.1, 1.0)
    every = max(1, round(_ASKED_EVERY / (step * period)))
    out = []
    for count, k in enumerate(range(0, len(attitude) - ahead, step)):
        w, x, y, z = attitude[k]
        track.add(AhrsReading(k * period, np.array([x, y, z, w]), "robot"))
        if count % every == 0 and moves[k]:
            there = track.at((k + ahead) * period)
            if there is not None:
                came = rotation_from_quaternion(attitude[k + ahead])
                out.append(float(np.linalg.norm(rotation_log(came.T @ there))))
    return np.asarray(out)


def _times(a: Array, b: Array) -> Array:
    """Products (N, 4) of quaternions, w x y z."""
    w, v, s, u = a[:, :1], a[:, 1:], b[:, :1], b[:, 1:]
    return np.hstack([w * s - (v * u).sum(axis=1, keepdims=True), w * u + s * v + np.cross(v, u)])

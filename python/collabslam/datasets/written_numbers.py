"""Stamps, poses and covariances that are to be written: checked, and so that they come out the same again."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from collabslam.datasets.poses import rigid
from collabslam.datasets.units import NANOSECONDS
from collabslam.errors import DataError, InputError
from collabslam.geometry import quaternion_wxyz
from collabslam.types import Array

_DECIMALS = 14


def following_stamp(t: float, last: int) -> int:
    """Nanoseconds of a stamp that follows the last one."""
    stamp = whole_nanoseconds(t)
    if stamp <= last:
        raise InputError(
            f"The time stamp {t} s does not follow the last one, {last / NANOSECONDS} s; give stamps in "
            "seconds that increase by a nanosecond or more."
        )
    return stamp


def stable_quaternion(rotation: Array) -> list[float]:
    """Quaternion w x y z that comes out the same when its own rotation matrix is written again.

    Three parts are rounded to 14 decimals (1e-14 rad), far more coarsely than arithmetic disturbs them; the
    remaining one, which is not small, follows from the norm.
    """
    q = quaternion_wxyz(rotation)
    kept = int(np.flatnonzero(np.abs(q) >= 0.5 - 1e-9)[0])
    rounded = [round(float(x), _DECIMALS) for x in q]
    rest = sum(x * x for k, x in enumerate(rounded) if k != kept)
    rounded[kept] = float(np.copysign(np.sqrt(max(1.0 - rest, 0.0)), q[kept]))
    leading = next(x for x in rounded if x != 0.0)
    return [(-x if leading < 0.0 else x) + 0.0 for x in rounded]


def whole_nanoseconds(t: float) -> int:
    """Nanoseconds of a stamp, seconds; raises InputError if it is none."""
    try:
        stamp = round(Fraction(float(t)) * NANOSECONDS)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"The time stamp is {t!r}; give seconds as a finite number.") from error
    if not 0 <= stamp < 1 << 63:
        raise InputError(f"The time stamp is {t} s; give seconds from 0 to 9e9.")
    return stamp


def array_of(value: ArrayLike, shape: tuple[int, ...], name: str, *, finite: bool = True) -> Array:
    """An array of that shape, of finite numbers unless NaN may stand for what is not known."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"The {name} is not an array of numbers; give {shape} numbers.") from error
    if array.shape != shape or (finite and not np.isfinite(array).all()):
        raise InputError(f"The {name} has the shape {array.shape} or is not finite; give {shape} numbers.")
    return array


def checked_pose(value: ArrayLike, name: str) -> Array:
    """A 4x4 rigid pose, as it was given."""
    array = array_of(value, (4, 4), name)
    try:
        rigid(array, f"The {name}")
    except DataError as error:
        raise InputError(str(error)) from error
    if not np.array_equal(array[3], (0.0, 0.0, 0.0, 1.0)):
        raise InputError(f"The last row of the {name} is not 0 0 0 1; transpose it.")
    return array


def checked_covariance(value: ArrayLike, name: str) -> Array:
    """A 6x6 covariance: symmetric, and not negative in any direction."""
    array = array_of(value, (6, 6), name)
    largest = float(np.abs(np.diag(array)).max())
    if float(np.abs(array - array.T).max()) > 1e-9 * largest:
        raise InputError(f"The {name} is not symmetric; give (C + C.T) / 2.")
    if float(np.linalg.eigvalsh(array)[0]) < -1e-9 * largest:
        raise InputError(f"The {name} is not positive semidefinite; give variances, m^2 and rad^2.")
    return array


def pose_fields(t: Array) -> list[str]:
    """Position and quaternion w x y z of a pose (4, 4), as a file states them."""
    return [repr(float(x) + 0.0) for x in t[:3, 3]] + [repr(x) for x in stable_quaternion(t[:3, :3])]

"""Which columns of a table of poses are which, by the names in its header."""

from __future__ import annotations

import re
from collections.abc import Sequence

from collabslam.errors import DataError

HEADER = 5
"""Lines at the beginning of a file that may name its columns."""
_DEGREES = re.compile(r"(?:gps_)?(?:lat|lon|lng|long|latitude|longitude)(?:_?deg(?:rees)?)?")
_STAMP = re.compile(
    r"(?:(?:header|field)_)*(?:time|time_?stamp|stamp|t)(?:_?(?:s|sec|secs|seconds|ns|us|ms))?"
)
_QUATERNION = re.compile(r"(?:(?:q|quat|quaternion|orientation|rot|rotation)_?|q_[a-z]+_)([wxyz])")
_TWIST = r"(?:(?:field|msg|twist)_)*{}_?([xyz])(?:_(?:m_s|rad_s|mps|rps))?"
_VELOCITY = re.compile(_TWIST.format("(?:v|vel|velocity|linear|linear_velocity)"))
_RATE = re.compile(_TWIST.format("(?:w|omega|gyro|rate|angular|angular_velocity)"))
_POSITION = re.compile(r"(?:(?:t|p|pos|position|trans|translation)_?|p_[a-z]+_[a-z]_?)?([xyz])")


def columns_of(text: str) -> list[int] | None:
    """Columns of stamp, x, y, z, qx, qy, qz, qw, where a header of a table names each once; None if not.

    Parameters
    ----------
    text : str
        Of the file, as those of Stray Scanner, of ``rostopic echo -p`` or of pandas.

    Raises
    ------
    DataError
        If it names a latitude or a longitude: degrees are no positions.
    """
    for line in text.splitlines()[:HEADER]:
        names = _names(line)
        if any(_DEGREES.fullmatch(name) for name in names):
            raise DataError(
                f"The poses have columns '{line.strip()[:60]}': latitude and longitude are degrees; give "
                "positions in metres, as east, north, up from the first."
            )
        found = [_only(names, _STAMP, "")]
        found += [_only(names, _POSITION, axis) for axis in "xyz"]
        found += [_only(names, _QUATERNION, axis) for axis in "xyzw"]
        columns = [column for column in found if column is not None]
        if len(columns) == len(found):
            return columns
    return None


def twist_columns_of(text: str, where: object) -> list[int] | None:
    """Columns of stamp, vx, vy, vz, wx, wy, wz, where a header of a table names each once; None without one.

    Raises
    ------
    DataError
        If it names some of them alone: nobody knows then which column is which.
    """
    for line in text.splitlines()[:HEADER]:
        names = _names(line)
        found = [_only(names, pattern, axis) for pattern in (_VELOCITY, _RATE) for axis in "xyz"]
        columns = [column for column in (_only(names, _STAMP, ""), *found) if column is not None]
        if len(columns) == 1 + len(found):
            return columns
        if any(column is not None for column in found):
            raise DataError(
                f"The columns of {where} are '{line.strip()[:60]}'; name stamp, vx, vy, vz, wx, wy, wz, each "
                "once, or give them in this order without names (0 for what is not there)."
            )
    return None


def _names(line: str) -> list[str]:
    """Names of a header in one form: ``field.header.stamp`` is header_stamp, ``p_RS_R_x [m]`` p_rs_r_x."""
    line = re.sub(r"\[[^\]]*\]|\"", "", line.strip().lstrip("#%/ "))
    parts = re.split(r"[,;\t]", line) if re.search(r"[,;\t]", line) else line.split()
    names = (re.sub(r"[^a-z0-9]+", "_", part.strip().lower()).strip("_") for part in parts)
    return [re.sub(r"^(?:field_)?(?:pose_)*(?=position|orientation|header)", "", name) for name in names]


def _only(names: Sequence[str], pattern: re.Pattern[str], axis: str) -> int | None:
    """The one column whose name fits, and ends with the axis; the more plainly named one of several."""
    fits = [
        k for k, name in enumerate(names) if (m := pattern.fullmatch(name)) and (not axis or m[1] == axis)
    ]
    return min(fits, key=lambda k: len(names[k])) if len({names[k] for k in fits}) == len(fits) > 0 else None

"""Pose files and time stamps: reading, checking, interpolating."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from collabslam.errors import DataError
from collabslam.formats.files import read_text
from collabslam.geometry import interpolate_pose, nearest_rotation, pose, pose_from_quaternion
from collabslam.types import Array

NANOSECONDS = 10**9
# Integers from here on are nanoseconds since 1970; up to the other limit they are seconds.
_LEAST_NANOSECONDS = 10**17
_MOST_SECONDS = 10**11
_MOST_DIGITS = 19  # of a stamp in nanoseconds
_CLAMP_SECONDS = 1e-3
_ROTATION_TOLERANCE = 1e-2
FARTHEST = 1e9
"""Metres beyond which no position is believed."""


def seconds(nanoseconds: int) -> float:
    """Seconds of an integer nanosecond stamp, correctly rounded."""
    return nanoseconds / NANOSECONDS


def nanoseconds(text: str, where: str) -> int:
    """An integer nanosecond stamp; DataError if it is not one, or beyond 64 bits."""
    if not re.fullmatch(r"[0-9]+", text):
        raise DataError(f"The stamp '{text}' in {where} is not an integer; this layout counts nanoseconds.")
    if len(text) > _MOST_DIGITS or int(text) >= 1 << 63:
        raise DataError(f"The stamp {text[:24]}... in {where} is beyond 64 bits; correct it.")
    return int(text)


def parse_stamp(text: str, where: str) -> float:
    """Seconds of a stamp written in seconds, or in integer nanoseconds.

    Raises
    ------
    DataError
        If it is no number, or an integer whose unit cannot be told.
    """
    text = text.strip()
    if re.fullmatch(r"[0-9]+", text):
        if len(text) > _MOST_DIGITS:
            raise DataError(f"The stamp {text[:24]}... in {where} is far too large; write it in seconds.")
        value = int(text)
        if value >= _LEAST_NANOSECONDS:
            return seconds(value)
        if value <= _MOST_SECONDS:
            return float(value)
        raise DataError(
            f"The stamp {text} in {where} is neither seconds nor nanoseconds since 1970; write it in seconds."
        )
    try:
        stamp = float(text)
    except ValueError as error:
        raise DataError(f"The stamp '{text}' in {where} is not a number; write it in seconds.") from error
    if not np.isfinite(stamp):
        raise DataError(f"The stamp '{text}' in {where} is not finite; write it in seconds.")
    return stamp


def data_lines(path: Path) -> list[tuple[int, list[str]]]:
    """Line numbers and fields of a text file; commas or blanks part fields, ``#`` starts a comment.

    Raises
    ------
    DataError
        If the file cannot be read.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"The file {path} cannot be read as text; give an existing text file.") from error
    out = []
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.split("#", 1)[0].replace(",", " ").split()
        if fields:
            out.append((number, fields))
    return out


def number_fields(fields: Iterable[str], where: str) -> list[float]:
    """Fields as floats; DataError naming ``where`` if one is no number."""
    try:
        return [float(x) for x in fields]
    except ValueError as error:
        raise DataError(f"{where} holds something that is not a number; correct the line.") from error


def check_position(position: Sequence[float] | Array, where: str) -> None:
    """Raises DataError if a position, metres, is beyond `FARTHEST`."""
    if float(np.max(np.abs(position))) > FARTHEST:
        raise DataError(f"{where} is more than {FARTHEST:g} m away from its origin; give metres.")


def rigid(matrix: Array, where: str) -> Array:
    """A 4x4 pose with its rotation made orthonormal (files carry few digits); all NaN if not finite.

    Raises
    ------
    DataError
        If the upper left 3x3 is not near a rotation.
    """
    if not bool(np.all(np.isfinite(matrix))):
        return np.full((4, 4), np.nan)
    check_position(matrix[:3, 3], where)
    if float(np.max(np.abs(matrix[:3, :3]))) > 2.0:
        raise DataError(f"{where} is not a rigid pose (its 3x3 is no rotation); check its numbers' order.")
    rotation = nearest_rotation(matrix[:3, :3])
    if float(np.max(np.abs(rotation - matrix[:3, :3]))) > _ROTATION_TOLERANCE:
        raise DataError(
            f"{where} is not a rigid pose (its 3x3 is no rotation); check the order of its numbers."
        )
    return pose(rotation, matrix[:3, 3])


def read_pose_rows(path: Path) -> Array:
    """Poses of a file with one 4x4 (16 numbers) or 3x4 (12 numbers) matrix a line: (N, 4, 4).

    Raises
    ------
    DataError
        Naming the line that is wrong.
    """
    out = []
    for number, fields in data_lines(path):
        where = f"Line {number} of {path}"
        values = number_fields(fields, where)
        if len(values) not in (12, 16):
            raise DataError(f"{where} has {len(values)} numbers; a pose is 12 (3x4) or 16 (4x4), row by row.")
        matrix = np.eye(4)
        matrix[: len(values) // 4] = np.asarray(values).reshape(-1, 4)
        out.append(rigid(matrix, where))
    if not out:
        raise DataError(f"The pose file {path} holds no poses; give one matrix a line.")
    return np.asarray(out)


def read_track(path: Path, *, euroc: bool = False) -> tuple[Array, Array]:
    """A stamped trajectory: ``t tx ty tz qx qy qz qw`` (TUM), or EuRoC's ``ns tx ty tz qw qx qy qz``.

    Parameters
    ----------
    path
        Text or CSV file; further columns are ignored.
    euroc
        EuRoC's order; its stamps are always nanoseconds, TUM's are seconds or nanoseconds since 1970.

    Returns
    -------
    (N,) stamps in seconds, (N, 4, 4) poses; sorted by stamp.

    Raises
    ------
    DataError
        Naming the line that is wrong.
    """
    stamps, poses = [], []
    columns = "ns tx ty tz qw qx qy qz" if euroc else "t tx ty tz qx qy qz qw"
    for number, fields in data_lines(path):
        where = f"Line {number} of {path}"
        if len(fields) < 8:
            raise DataError(f"{where} has {len(fields)} columns; a stamped pose needs 8: {columns}.")
        values = number_fields(fields[1:8], where)
        q = np.asarray(values[3:] if euroc else [values[6], *values[3:6]])
        if not np.all(np.isfinite(values)) or abs(float(np.linalg.norm(q)) - 1.0) > _ROTATION_TOLERANCE:
            raise DataError(f"{where} holds no unit quaternion; check the order of the columns.")
        check_position(values[:3], where)
        stamps.append(seconds(nanoseconds(fields[0], where)) if euroc else parse_stamp(fields[0], where))
        poses.append(pose_from_quaternion(values[:3], q))
    if not stamps:
        raise DataError(f"The trajectory {path} holds no poses; give lines of {columns}.")
    order = np.argsort(stamps, kind="stable")
    return np.asarray(stamps)[order], np.asarray(poses)[order]


def interpolate_track(stamps: Array, poses: Array, times: Array, widest: float | None = None) -> Array:
    """Poses of a trajectory at other times.

    Between two stamps the pose is interpolated, unless they are too far apart; within 1 ms of a stamp its own
    pose is good enough, so that rounded stamps still meet.

    Parameters
    ----------
    stamps : (N,) array
        Sorted, seconds.
    poses : (N, 4, 4) array
    times : (M,) array
    widest : float, optional
        Longest gap to interpolate over, seconds; three times the median spacing unless told, 0 for none.

    Returns
    -------
    (M, 4, 4) array
        NaN where the trajectory says nothing.
    """
    out = np.full((len(times), 4, 4), np.nan)
    if widest is None:
        widest = 3.0 * float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    for k, t in enumerate(times):
        after = int(np.searchsorted(stamps, t))
        before = after - 1
        if 0 < after < len(stamps) and stamps[after] - stamps[before] <= widest:
            share = float((t - stamps[before]) / (stamps[after] - stamps[before]))
            out[k] = interpolate_pose(poses[before], poses[after], share)
            continue
        near = min((i for i in (before, after) if 0 <= i < len(stamps)), key=lambda i: abs(stamps[i] - t))
        if abs(stamps[near] - t) <= _CLAMP_SECONDS:
            out[k] = poses[near]
    return out

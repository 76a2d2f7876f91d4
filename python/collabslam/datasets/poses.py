"""Pose files: reading, checking, interpolating."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np

from collabslam.datasets.gate import data_lines, is_number, leave_columns, tell, text_of
from collabslam.datasets.pose_columns import HEADER, columns_of
from collabslam.datasets.units import as_seconds, counts, read_stamps
from collabslam.errors import DataError, SettingsError
from collabslam.geometry import (
    interpolate_pose,
    nearest_rotation,
    pose,
    pose_from_quaternion,
)
from collabslam.types import Array

_CLAMP_SECONDS = 1e-3
_ROTATION_TOLERANCE = 1e-2
_QUATERNION = re.compile(r"\b(?:q(?:_?[a-z]+[_.]|_)?|orientation[_.])([wxyz])\b", re.IGNORECASE)
_FEW = 20
"""A file of poses may have one broken line in so many."""
BODY_FROM_OPTICAL = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0, 0, 0, 1.0]]
)
"""Maps optical axes (x right, y down, z forward) into ROS's body axes (x forward, y left, z up)."""
OPENGL_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0, 1.0])
"""Maps optical axes into OpenGL's (x right, y up, z back), which ARKit, ARCore and Blender have, and back."""
AXES = {"optical": np.eye(4), "opengl": OPENGL_FROM_OPTICAL, "ros": BODY_FROM_OPTICAL}
"""Maps optical axes into those of each name."""
FARTHEST = 1e9
"""Metres beyond which no position is believed."""


def number_fields(fields: Iterable[str], where: str) -> list[float]:
    """Fields as floats; DataError naming ``where`` if one is not a number."""
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
        raise DataError(f"{where} is not a rigid pose (its 3x3 is not a rotation); check its numbers' order.")
    rotation = nearest_rotation(matrix[:3, :3])
    if float(np.max(np.abs(rotation - matrix[:3, :3]))) > _ROTATION_TOLERANCE:
        raise DataError(
            f"{where} is not a rigid pose (its 3x3 is not a rotation); check the order of its numbers."
        )
    if matrix.shape == (4, 4) and float(np.max(np.abs(matrix[3] - (0.0, 0.0, 0.0, 1.0)))) > 1e-6:
        raise DataError(f"{where} is not a rigid pose (its last row is not 0 0 0 1); give it row by row.")
    return pose(rotation, matrix[:3, 3])


def axes_of(name: str) -> Array:
    """Maps optical axes (4, 4) into those of a name, one of `AXES`; raises SettingsError."""
    if name not in AXES:
        raise SettingsError(f"There are no camera axes '{name}'; give one of {', '.join(AXES)}.")
    return AXES[name]


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
    tell("poses", f"{len(out)} matrices, a line each", path)
    return np.asarray(out)


class PoseRows(NamedTuple):
    """Poses of a file, sorted by their stamps.

    ``texts`` are the stamps as they were written, ``stamps`` seconds, ``poses`` (4, 4), ``further`` the
    numbers that follow in each line.
    """

    texts: list[str]
    stamps: list[Decimal]
    poses: list[Array]
    further: list[Array]
    lines: list[int]


def read_pose_table(
    path: Path, *, order: str = "xyzw", further: tuple[int, ...] | None = None, usual: str | None = None
) -> PoseRows:
    """Lines of stamp, position, quaternion and further numbers.

    Lines that are not finite, as trackers write them while they are lost, are left out and told, and so are
    single ones that are broken, such as the last one of a program that was killed.

    Parameters
    ----------
    path
        Text or CSV file.
    order
        Of the quaternion; a header that names the columns is believed more.
    further
        How many numbers may follow; any if None, and they are not read.
    usual
        The unit of its stamps, see `units.read_stamps`.

    Raises
    ------
    DataError
        Naming the line that is wrong, if more than one of `_FEW` are.
    """
    order = order_of_header(path) or order
    rows: list[tuple[str, Array, int]] = []
    lost, broken = 0, list[DataError]()
    lines = data_lines(path)
    columns = columns_of(text_of(path)) if further is None else None
    named = columns is not None and all(len(fields) > max(columns) for _, fields in lines)
    if columns is not None and named:
        if others := max(len(fields) for _, fields in lines) - len(columns):
            tell("passed over", f"{others} columns (by their names neither stamp nor pose)", path)
        order, lines = "xyzw", [(n, [fields[k] for k in columns]) for n, fields in lines]
    skip = after_id(lines)
    if further is None:
        leave_columns((fields for _, fields in lines), skip + 8, path)
    for number, fields in lines:
        where = f"Line {number} of {path}"
        try:
            values = _pose_fields(fields[skip:], order, further, where)
        except DataError as error:
            broken.append(error)
            continue
        if np.isfinite(values).all():
            rows.append((fields[skip], values, number))
        else:
            lost += 1
    if broken and len(broken) * _FEW > len(lines):
        raise broken[0]
    if not rows:
        none = f"no poses; {lost} lines are not finite" if lost else "no poses"
        raise DataError(f"{path} holds {none}; give lines of stamp, x y z, q{' q'.join(order)}.")
    numbers = [number for _, _, number in rows]
    stamps = read_stamps([text for text, _, _ in rows], str(path), lines=numbers, usual=usual)
    left_out = f"; {lost} not finite and {len(broken)} broken left out" if lost or broken else ""
    told = "by the header" if named else " ".join(order)
    tell("poses", f"{len(rows)} of {len(lines)} lines, quaternions {told}{left_out}", path)
    scalar_first = [order.index(axis) + 3 for axis in "wxyz"]
    ranked = sorted(range(len(rows)), key=lambda k: stamps[k])
    return PoseRows(
        [rows[k][0] for k in ranked],
        [stamps[k] for k in ranked],
        [pose_from_quaternion(rows[k][1][:3], rows[k][1][scalar_first]) for k in ranked],
        [rows[k][1][7:] for k in ranked],
        [rows[k][2] for k in ranked],
    )


def _pose_fields(fields: list[str], order: str, further: tuple[int, ...] | None, where: str) -> Array:
    """Position, quaternion as it is written, and further numbers; DataError if they are none."""
    columns = f"stamp, x y z, q{' q'.join(order)}"
    if len(fields) < 8 if further is None else len(fields) - 8 not in further:
        counts = "8" if further is None else " or ".join(str(8 + n) for n in further)
        behind = [_BEHIND[n] for n in further or () if n in _BEHIND]
        columns += f", and {' or '.join(behind)}" if behind else ""
        raise DataError(f"{where} has {len(fields)} columns; {counts} are needed: {columns}.")
    values = np.asarray(number_fields(fields[1:] if further is not None else fields[1:8], where))
    if np.isfinite(values).all():
        if abs(float(np.linalg.norm(values[3:7])) - 1.0) > _ROTATION_TOLERANCE:
            raise DataError(f"{where} holds no unit quaternion; check the order of the columns ({columns}).")
        check_position(values[:3], where)
    return values


_BEHIND = {2: "two standard deviations, metres and degrees", 21: "21 numbers of the covariance"}
"""What further numbers stand behind a pose."""


def after_id(lines: list[tuple[int, list[str]]]) -> int:
    """1 if a first column counts the lines of nine, before the stamp; else 0."""
    nine = all(len(fields) == 9 and is_number(fields[1]) for _, fields in lines)
    return int(nine and counts([fields[0] for _, fields in lines]))


def order_of_header(path: Path) -> str | None:
    """The order of the quaternion that a file's first lines tell by their columns' names."""
    for line in text_of(path).splitlines()[:HEADER]:
        found = "".join(_QUATERNION.findall(line)).lower()
        if found in ("wxyz", "xyzw"):
            return found
    return None


def read_track(path: Path, *, euroc: bool = False) -> tuple[Array, Array]:
    """A stamped trajectory: ``t tx ty tz qx qy qz qw`` (TUM), or EuRoC's ``ns tx ty tz qw qx qy qz``.

    Parameters
    ----------
    path
        Text or CSV file; further columns are ignored.
    euroc
        EuRoC's order and unit.

    Returns
    -------
    (N,) stamps in seconds, (N, 4, 4) poses; sorted by stamp.

    Raises
    ------
    DataError
        As `read_pose_table`.
    """
    rows = read_pose_table(path, order="wxyz" if euroc else "xyzw", usual="nanoseconds" if euroc else None)
    return as_seconds(rows.stamps), np.asarray(rows.poses)


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

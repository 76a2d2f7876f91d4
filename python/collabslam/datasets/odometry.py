"""Odometry beside a recording: files of twists, checked before a run begins (METHOD section 23)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collabslam._core import Filter
from collabslam.datasets.gate import data_lines, leave_columns, tell, text_of
from collabslam.datasets.pose_columns import twist_columns_of
from collabslam.datasets.poses import BODY_FROM_OPTICAL, check_position, number_fields
from collabslam.datasets.units import as_seconds, read_stamps
from collabslam.errors import DataError, InputError
from collabslam.geometry import left_jacobian, pose_inverse, rotation_log
from collabslam.types import Array, Odometry

TRIANGLE = np.tril_indices(6)
"""Rows and columns of the 21 numbers of a covariance."""
UNMEASURED = 1e4
"""Variance, (m/s)^2 or (rad/s)^2, of what is not measured, whatever larger number stands for it."""


@dataclass(frozen=True)
class OdometryGiven:
    """Odometry that is given beside a recording.

    Attributes
    ----------
    source : str
        A file, or a topic of a bag.
    mount : tuple of float
        Where Cs sits in the odometry's frame B (x ahead, y left, z up): x, y, z, metres, and roll, pitch,
        yaw, degrees, of a camera that looks along x; the angles may be left out.
    frames : (str, str) or None
        In place of ``mount``: the frames of B and of Cs's images (x right, y down, z forward) in a bag's tf.
    sd : tuple of float or None
        Standard deviations of velocity, m/s, and angular velocity, rad/s, of every axis, in place of the
        source's covariances.
    """

    source: str
    mount: tuple[float, ...] = (0.0, 0.0, 0.0)
    sd: tuple[float, float] | None = None
    frames: tuple[str, str] | None = None

    def t_bc(self) -> Array:
        """(4, 4), maps points of C into B, metres; raises DataError where only a bag's tf could say it."""
        if self.frames is not None:
            raise DataError(
                f"The odometry of {self.source} is not a topic of a bag, whose tf would say where Cs sits; "
                "give x,y,z (metres)."
            )
        return mounted(self.mount)


def mounted(mount: Sequence[float]) -> Array:
    """T_BC (4, 4) of x, y, z (metres) and, if given, roll, pitch, yaw (degrees, about the fixed x, y, z of B)
    of a camera that looks along x without them; raises DataError for other numbers."""
    if len(mount) not in (3, 6) or not np.isfinite(mount).all():
        raise DataError(
            f"The camera's place in the odometry's frame has {len(mount)} numbers; give x,y,z (metres) or "
            "x,y,z,roll,pitch,yaw (metres, degrees)."
        )
    check_position(mount[:3], "The camera's place in the odometry's frame")
    roll, pitch, yaw = np.deg2rad(mount[3:]) if len(mount) == 6 else (0.0, 0.0, 0.0)
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    turn_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    turn_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    turn_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    t_bc = np.eye(4)
    t_bc[:3, :3] = turn_z @ turn_y @ turn_x @ BODY_FROM_OPTICAL[:3, :3]
    t_bc[:3, 3] = mount[:3]
    return t_bc


def mount_of(t_bc: Array) -> tuple[float, ...]:
    """The numbers that `mounted` makes (4, 4) ``T_BC`` of: x, y, z (metres), roll, pitch, yaw (degrees)."""
    turn = t_bc[:3, :3] @ BODY_FROM_OPTICAL[:3, :3].T
    pitch = float(np.arcsin(np.clip(-turn[2, 0], -1.0, 1.0)))
    if abs(turn[2, 0]) > 1.0 - 1e-9:  # looks straight up or down: roll and yaw turn alike
        roll, yaw = 0.0, float(np.arctan2(-turn[0, 1], turn[1, 1]))
    else:
        roll = float(np.arctan2(turn[2, 1], turn[2, 2]))
        yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
    return (*map(float, t_bc[:3, 3]), *(float(a) for a in np.rad2deg([roll, pitch, yaw])))


def read_odometry(path: Path, given: OdometryGiven) -> Odometry:
    """Odometry of a text file: stamp, vx vy vz (m/s), wx wy wz (rad/s), and 21 numbers of the covariance.

    Commas or blanks part the fields, ``#`` starts a comment; a header that names the seven columns is
    believed.  The 21 numbers are the lower triangle of the 6x6 covariance, row by row; they may be left out
    where ``given.sd`` says it.

    Raises
    ------
    DataError
        If the file cannot be read or a row is none.
    """
    rows, lines = [], data_lines(path)
    columns = twist_columns_of(text_of(path), path)
    if columns is not None:
        lines = _by_names(lines, columns, path)
    for number, texts in lines:
        where = f"Line {number} of {path}"
        if len(texts) not in (7, 28):
            raise DataError(
                f"{where} has {len(texts)} columns; 7 are needed (stamp, vx, vy, vz, wx, wy, wz), or 28 with "
                "21 of the covariance."
            )
        rows.append(number_fields(texts[1:], where))
    if len({len(row) for row in rows}) > 1:
        raise DataError(f"Some rows of {path} have a covariance and some have none; give all of them one.")
    if not rows:
        raise DataError(f"The file {path} holds no odometry; give one row for each sample.")
    stamps = as_seconds(read_stamps([f[0] for _, f in lines], str(path), lines=[n for n, _ in lines]))
    return of_table(np.column_stack([stamps, np.asarray(rows)]), given.t_bc(), str(path), given.sd)


def _by_names(
    lines: list[tuple[int, list[str]]], columns: list[int], path: Path
) -> list[tuple[int, list[str]]]:
    """Lines with the columns that a header names, in our order; 21 of a covariance stay behind them."""
    if columns == list(range(7)) and all(len(texts) == 28 for _, texts in lines):
        return lines
    short = [number for number, texts in lines if len(texts) <= max(columns)]
    if short:
        raise DataError(f"Line {short[0]} of {path} has fewer columns than its header names; write it whole.")
    tell("columns", f"{', '.join(str(k + 1) for k in columns)}: stamp, vx, vy, vz, wx, wy, wz", path)
    leave_columns([texts for _, texts in lines], 7, f"{path}, beside the columns that are named")
    return [(number, [texts[k] for k in columns]) for number, texts in lines]


def of_table(table: Array, t_bc: Array, where: str, sd: tuple[float, float] | None = None) -> Odometry:
    """Odometry of rows of stamp, twist and, if they have them, 21 numbers of the covariance; as `checked`."""
    covariances = np.zeros((len(table), 6, 6))
    if table.shape[1] > 7:
        covariances[:, TRIANGLE[0], TRIANGLE[1]] = table[:, 7:]
        covariances[:, TRIANGLE[1], TRIANGLE[0]] = table[:, 7:]
    return checked(table[:, 0], table[:, 1:7], covariances, t_bc, where, sd)


def checked(
    times: Array,
    twists: Array,
    covariances: Array,
    t_bc: Array,
    where: str,
    sd: tuple[float, float] | None = None,
) -> Odometry:
    """Odometry whose numbers the filter takes; raises DataError naming the first sample that it would not.

    Variances beyond (100 m/s)^2 stand for axes that were not measured, whatever their size; ``sd`` is in
    place of all of them.
    """
    if sd is not None:
        v, w = sd
        covariances = np.tile(np.diag([v * v] * 3 + [w * w] * 3), (len(times), 1, 1))
    tell("odometry", f"{len(times)} samples", where)
    covariances = _bounded(covariances)
    steps = np.flatnonzero(~(np.diff(times) > 0.0))
    if len(steps):
        t = times[steps[0] + 1]
        raise DataError(f"The stamp {t} s in {where} does not follow the one before; sort the samples.")
    remedy = "" if sd is not None else "; or state the noise: --odometry-sd M_PER_S,RAD_PER_S"
    for t, twist, covariance in zip(times.tolist(), twists, covariances, strict=True):
        _check(twist, covariance, f"The sample at {t} s in {where}", remedy)
    return Odometry(times, twists, covariances, t_bc)


def check_covers(odometry: Odometry, frames: Array, where: str) -> None:
    """Tells how many frames samples come before and after; DataError if it is none: another clock's.

    Parameters
    ----------
    odometry : Odometry
    frames : (M,) array
        Stamps of the frames, seconds.
    where : str
        The file or topic, for messages.
    """
    first, last = (float(odometry.times[k]) for k in (0, -1))
    covered = int(np.sum((frames >= first) & (frames <= last)))
    if covered == 0:
        raise DataError(
            f"The odometry of {where} ({first:.3f} to {last:.3f} s) and the images ({frames[0]:.3f} to "
            f"{frames[-1]:.3f} s) share no time; give both in the same clock."
        )
    if covered < len(frames):
        tell("odometry", f"covers {covered} of {len(frames)} frames", where)


def _check(twist: Array, covariance: Array, which: str, remedy: str) -> None:
    try:
        Filter.check_odometry(twist, covariance)
    except InputError as error:
        raise DataError(f"{which} cannot be used: {error}{remedy}.") from error


def increments(times: Array, poses: Array, first: Array) -> Array:
    """Mean twists (N, 6) between poses T_OB (N, 4, 4), each since the one before; ``first`` (6,) stays.

    A body that moves with a constant twist from one pose comes to the next.
    """
    twists = [np.asarray(first, np.float64)]
    for k in range(1, len(times)):
        step = pose_inverse(poses[k - 1]) @ poses[k]
        dt = times[k] - times[k - 1]
        turn = rotation_log(step[:3, :3])
        way = np.linalg.solve(left_jacobian(turn), step[:3, 3])
        twists.append(np.concatenate([way, turn]) / dt)
    return np.asarray(twists)


def _bounded(covariances: Array) -> Array:
    """Covariances in which an axis that was not measured has one and the same large variance."""
    out: Array = covariances.copy()
    samples, axes = np.nonzero(np.diagonal(covariances, axis1=1, axis2=2) > UNMEASURED)
    out[samples, axes, :] = 0.0
    out[samples, :, axes] = 0.0
    out[samples, axes, axes] = UNMEASURED
    return out

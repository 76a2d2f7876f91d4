"""Trajectories as text: TUM with a covariance sidecar, EuRoC CSV, KITTI.

``T_WC`` maps points of the camera C into W; metres (or an arbitrary unit, which TUM files say), seconds.
Every file is sorted by time and leaves out poses that are not finite.
"""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from collabslam.errors import DataError
from collabslam.formats.files import read_text, write_text
from collabslam.geometry import quaternion_wxyz
from collabslam.types import Array

METRES, ARBITRARY = "metres", "an arbitrary unit"
_TUM_HEADER = "# t tx ty tz qx qy qz qw: seconds, {}; T_WC maps points of the camera C into W"
_COV_HEADER = """\
# Covariance of each pose of {of}, row by row: t, then the 21 numbers of the lower triangle
# c11 c21 c22 c31 ... c66 of the 6x6 matrix over (x y z rx ry rz), lengths in {unit}, angles in radians.
# Tangent on the right, in the camera's frame C: T_WC = T_WC_hat Exp(xi).
#%TANGENT_CONVENTION right_perturbation
#%TANGENT_ORDER translation_rotation"""
_TRIANGLE = np.tril_indices(6)
_EUROC_HEADER = (
    "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
)


def position_quaternion(t_wc: Array) -> list[float]:
    """``x y z qx qy qz qw`` of a pose."""
    w, x, y, z = quaternion_wxyz(t_wc[:3, :3])
    return [*(float(v) for v in t_wc[:3, 3]), float(x), float(y), float(z), float(w)]


def tum_line(t: float, t_wc: Array) -> str:
    """A pose in the TUM format, without an end of line."""
    return f"{t:.9f} " + " ".join(f"{v:.9f}" for v in position_quaternion(t_wc))


def covariance_line(t: float, covariance: Array) -> str:
    """A covariance (6, 6) as its lower triangle, without an end of line."""
    return f"{t:.9f} " + " ".join(f"{v:.12e}" for v in covariance[_TRIANGLE])


def tum_header(unit: str = METRES, note: str = "") -> str:
    """First lines of a TUM file, with an end of line; ``note`` is a comment for the very first."""
    return "".join(line + "\n" for line in (note, _TUM_HEADER.format(unit)) if line)


def covariance_header(unit: str = METRES, of: str = "trajectory.tum") -> str:
    """First lines of a covariance file, with an end of line: unit, frame and order; ``of`` has the poses."""
    return _COV_HEADER.format(unit=unit, of=of) + "\n"


def write_tum(path: Path, times: ArrayLike, poses: ArrayLike, note: str = "", unit: str = METRES) -> None:
    """Poses (N, 4, 4) in the TUM format; ``note`` is a comment for the file's first line."""
    lines = (tum_line(t, t_wc) + "\n" for t, t_wc in _finite(times, poses))
    write_text(path, tum_header(unit, note) + "".join(lines))


def write_covariances(path: Path, times: ArrayLike, covariances: ArrayLike, unit: str = METRES) -> None:
    """Covariances (N, 6, 6) as lower triangles; the header states frame and order."""
    lines = (covariance_line(t, p) + "\n" for t, p in _finite(times, covariances))
    write_text(path, covariance_header(unit) + "".join(lines))


def write_euroc(path: Path, times: ArrayLike, poses: ArrayLike) -> None:
    """Poses (N, 4, 4) as EuRoC's ground truth CSV: integer nanoseconds, position, quaternion scalar first."""
    lines = [_EUROC_HEADER]
    for t, t_wc in _finite(times, poses):
        x, y, z, qx, qy, qz, qw = position_quaternion(t_wc)
        lines.append(f"{round(t * 1e9)}," + ",".join(f"{v:.9f}" for v in (x, y, z, qw, qx, qy, qz)))
    write_text(path, "\n".join(lines) + "\n")


def kitti_stamps(path: Path) -> Path:
    """The file of stamps beside a file of KITTI poses."""
    return path.with_name(f"{path.stem}.times.txt")


def write_kitti(path: Path, times: ArrayLike, poses: ArrayLike) -> Path:
    """Poses (N, 4, 4) as KITTI's 12 numbers a line, the upper 3x4 row by row.

    Returns
    -------
    Path
        ``poses.times.txt`` beside ``poses.txt``: the stamps, which the format has no place for.
    """
    rows = _finite(times, poses)
    stamps = kitti_stamps(path)
    write_text(path, "".join(" ".join(f"{v:.9e}" for v in t_wc[:3].ravel()) + "\n" for _, t_wc in rows))
    write_text(stamps, "".join(f"{t:.9f}\n" for t, _ in rows))
    return stamps


def read_covariances(path: Path) -> tuple[Array, Array]:
    """Stamps (N,) and covariances (N, 6, 6) of a file that `write_covariances` wrote.

    Raises
    ------
    DataError
        If the file is missing, a line has not 22 numbers, or a variance is negative.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a run without a valid pose: there is no line
            rows = np.loadtxt(io.StringIO(read_text(path)), comments="#", ndmin=2, dtype=np.float64).reshape(
                -1, 22
            )
    except (OSError, ValueError) as error:
        raise DataError(
            f"The covariances {path} cannot be read ({error}); run the recording again."
        ) from error
    out = np.zeros((len(rows), 6, 6))
    i, j = _TRIANGLE
    out[:, i, j] = out[:, j, i] = rows[:, 1:]
    if (np.diagonal(out, axis1=1, axis2=2) < 0.0).any():
        raise DataError(
            f"The covariances {path} are damaged (a variance is negative); run the recording again."
        )
    return rows[:, 0], out


def _finite(times: ArrayLike, values: ArrayLike) -> list[tuple[float, Array]]:
    """(stamp, matrix) pairs in order of time, without matrices that are not finite."""
    t, matrices = np.asarray(times, np.float64), np.asarray(values, np.float64)
    return [
        (float(t[i]), matrices[i]) for i in np.argsort(t, kind="stable") if np.isfinite(matrices[i]).all()
    ]

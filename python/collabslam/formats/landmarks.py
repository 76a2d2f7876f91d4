"""Maps: points in W with their covariance, as binary PLY and as CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam.errors import DataError
from collabslam.formats.files import read_bytes, write_bytes, write_text
from collabslam.formats.trajectory import METRES
from collabslam.results import Landmarks
from collabslam.types import Array

_UPPER = (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2))
_PLY_TYPES = {"double": "<f8", "float": "<f4", "int": "<i4"}


def write_ply(path: Path, landmarks: Landmarks, unit: str = METRES) -> None:
    """The map as a binary PLY: points in W, in ``unit``, with sd along x, y, z and the 3x3 covariance."""
    columns = _columns(landmarks)
    table = np.empty(len(columns["x"]), dtype=[(name, _PLY_TYPES[_ply_type(name)]) for name in columns])
    for name, values in columns.items():
        table[name] = values
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment collabslam map: points in W and sigma in {unit}, cov in its square",
        f"element vertex {len(table)}",
        *(f"property {_ply_type(name)} {name}" for name in columns),
        "end_header",
    ]
    write_bytes(path, ("\n".join(header) + "\n").encode() + table.tobytes())


def write_csv(path: Path, landmarks: Landmarks) -> None:
    """The map as CSV with the PLY's columns, the id first."""
    columns = _columns(landmarks)
    names = ["id", *(name for name in columns if name != "id")]
    rows = zip(*(columns[name] for name in names), strict=True)
    lines = (",".join([str(int(row[0])), *(f"{v:.9g}" for v in row[1:])]) for row in rows)
    write_text(path, "\n".join([",".join(names), *lines]) + "\n")


def read_ply(path: Path) -> Landmarks:
    """A map that `write_ply` wrote.

    Raises
    ------
    DataError
        If it is missing or was written by another program.
    """
    try:
        head, end, body = read_bytes(path).partition(b"end_header\n")
    except OSError as error:
        raise DataError(
            f"The map {path} cannot be read ({error.strerror}); run the recording again."
        ) from error
    fields = [line.split()[1:] for line in head.decode("ascii", "replace").splitlines() if "property" in line]
    known = all(len(f) == 2 and f[0] in _PLY_TYPES for f in fields)
    names = [f[1] for f in fields if len(f) == 2]
    wanted = {"id", "x", "y", "z", *(f"cov_{name}" for name, _, _ in _UPPER)}
    if not end or not known or not wanted <= set(names) or len(set(names)) < len(names):
        raise DataError(f"The map {path} was not written by collabslam; give its own map.ply.")
    row = np.dtype([(name, _PLY_TYPES[kind]) for kind, name in fields])
    if len(body) % row.itemsize:
        raise DataError(f"The map {path} is cut off or too long; run the recording again.")
    table = np.frombuffer(body, dtype=row)
    covariance = np.empty((len(table), 3, 3))
    for name, i, j in _UPPER:
        covariance[:, i, j] = covariance[:, j, i] = table[f"cov_{name}"]
    points = np.stack([table[axis] for axis in "xyz"], axis=1)
    return Landmarks(table["id"].astype(np.int64), points, covariance)


def _columns(landmarks: Landmarks) -> dict[str, Array]:
    points = np.asarray(landmarks.points, np.float64).reshape(-1, 3)
    p = np.asarray(landmarks.covariance, np.float64).reshape(-1, 3, 3)
    columns: dict[str, Array] = {axis: points[:, k] for k, axis in enumerate("xyz")}
    for k, axis in enumerate("xyz"):
        columns[f"sigma_{axis}"] = np.sqrt(np.maximum(p[:, k, k], 0.0))
    columns |= {f"cov_{name}": p[:, i, j] for name, i, j in _UPPER}
    columns["id"] = np.asarray(landmarks.ids, np.float64)
    return columns


def _ply_type(name: str) -> str:
    return "int" if name == "id" else "double" if name in ("x", "y", "z") else "float"

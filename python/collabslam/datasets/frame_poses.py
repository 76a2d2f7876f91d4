"""Poses of a file at the times of frames, whatever program wrote it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from collabslam.datasets.gate import data_lines, read_keys, tell, text_of
from collabslam.datasets.named_poses import colmap_poses, is_colmap, nerfstudio_poses
from collabslam.datasets.poses import (
    after_id,
    axes_of,
    check_position,
    interpolate_track,
    number_fields,
    order_of_header,
    read_pose_rows,
    read_pose_table,
    rigid,
)
from collabslam.datasets.units import as_seconds, check_no_counter, counts, read_stamps
from collabslam.errors import DataError
from collabslam.geometry import pose, pose_from_quaternion, pose_inverse, rotation_exp
from collabslam.types import Array

_SEVERAL = 10
"""Of so many frames more than one must have a pose, if there are poses."""
FASTEST = 150.0
"""Metres a second between poses beyond which a camera's positions are not metres."""
_DIGITS = 16
"""Of a whole number that is nanoseconds since 1970."""


def poses_of_frames(path: Path, times: Array, axes: str | None = None, names: Sequence[str] = ()) -> Array:
    """Poses of a file at the times of frames, (N, 4, 4) with NaN where it says nothing.

    Parameters
    ----------
    path
        TUM, EuRoC with its header, or ARKitScenes' ``.traj``; or a pose for each frame without stamps: a
        matrix a line (KITTI), lines that are counted in place of stamps, Record3D's ``metadata``; or poses by
        the names of images: COLMAP's ``images.txt``, nerfstudio's ``transforms.json``.
    times : (N,) array
        Seconds.
    axes
        Of the camera, one of `AXES`; optical unless told, or as the file's program has them.
    names
        Of the frames' images, where they are files.

    Raises
    ------
    DataError
        If the file is none of these, or shares no time with the frames.
    SettingsError
        If there are no such axes.
    """
    keyed = text_of(path).lstrip()[:1] == "{"
    poses = _of_keys(path, len(times), names) if keyed else _of_lines(path, times, names)
    axes = axes or ("opengl" if keyed else "optical")
    tell("axes of the poses", axes, path)
    return np.asarray(poses @ axes_of(axes)) if axes != "optical" else poses


def _of_lines(path: Path, times: Array, names: Sequence[str]) -> Array:
    lines = data_lines(path)
    if is_colmap(lines):
        return colmap_poses(path, names)
    counted = {len(fields) for _, fields in lines}
    if path.suffix == ".traj" and counted == {7}:
        stamps, poses = _arkit_scenes(path)
    elif lines and counted <= {12, 16}:
        return _one_a_frame(read_pose_rows(path), len(times), f"{path} (a matrix for each frame, as KITTI's)")
    elif counted in ({13}, {17}) and (matrices := _stamped_matrices(lines, path)) is not None:
        stamps, poses = matrices
    else:
        _check_order_told(lines, path)
        rows, ids = read_pose_table(path), [fields[0] for _, fields in lines]
        if counts(ids) and not after_id(lines) and set(rows.texts) <= set(ids):
            every = np.full((len(ids), 4, 4), np.nan)
            every[[int(text) - int(ids[0]) for text in rows.texts]] = rows.poses
            return _one_a_frame(every, len(times), f"{path} (its lines count frames)")
        check_no_counter(rows.texts, str(path))
        stamps, poses = as_seconds(rows.stamps), np.asarray(rows.poses)
    found = interpolate_track(stamps, poses, times)
    met = int(np.isfinite(found).all(axis=(1, 2)).sum())
    if met == 0 or (met == 1 and len(times) >= _SEVERAL):
        hint = f" (as many as frames: --times {path} takes its stamps)" if len(stamps) == len(times) else ""
        raise DataError(
            f"The poses of {path} ({stamps[0]:.3f} to {stamps[-1]:.3f} s) and the images ({times[0]:.3f} to "
            f"{times[-1]:.3f} s) share no time but for {met} frames; give both in the same clock{hint}."
        )
    _check_speed(stamps, poses, path)
    return found


def _stamped_matrices(lines: list[tuple[int, list[str]]], path: Path) -> tuple[Array, Array] | None:
    """Stamps and poses of lines of a stamp and a matrix; None if these are no matrices."""
    try:
        values = np.array([[float(text) for text in fields[1:]] for _, fields in lines])
        matrices = np.tile(np.eye(4), (len(lines), 1, 1))
        matrices[:, : values.shape[1] // 4] = values.reshape(len(lines), -1, 4)
        poses = np.array([rigid(m, f"Line {n} of {path}") for m, (n, _) in zip(matrices, lines, strict=True)])
    except ValueError:
        return None
    stamps = as_seconds(read_stamps([fields[0] for _, fields in lines], str(path)))
    tell("poses", f"{len(lines)} lines of a stamp and a matrix", path)
    ranked = np.argsort(stamps, kind="stable")
    return stamps[ranked], poses[ranked]


def _check_order_told(lines: list[tuple[int, list[str]]], path: Path) -> None:
    """Refuses EuRoC's and VINS's form without a header: their quaternions begin with w, TUM's with x."""
    first = lines[0][1][0] if lines else ""
    commas = any("," in line.split("#")[0] for line in text_of(path).splitlines()[-2:])
    if commas and first.isdigit() and len(first) >= _DIGITS and order_of_header(path) is None:
        raise DataError(
            f"{path} has nanoseconds and commas as EuRoC's and VINS's files, whose quaternions begin with w, "
            "and no header that says so; write it as its first line: #timestamp,x,y,z,qw,qx,qy,qz (or qx,qy,"
            "qz,qw)."
        )


def _check_speed(stamps: Array, poses: Array, path: Path) -> None:
    steps, moved = np.diff(stamps), np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    good = np.isfinite(moved) & (steps > 0.0)
    speed = float(np.median(moved[good] / steps[good])) if good.sum() > 1 else 0.0
    if speed > FASTEST:
        raise DataError(
            f"The poses of {path} move at {speed:.0f} m/s, which no camera does; give positions in metres."
        )


def _one_a_frame(poses: Array, count: int, where: str) -> Array:
    if len(poses) != count:
        raise DataError(f"{where} has {len(poses)} poses for {count} frames; give one for each, or stamps.")
    tell("poses", f"{count}, one for each frame", where)
    return poses


def _arkit_scenes(path: Path) -> tuple[Array, Array]:
    """Stamps and poses of a ``.traj``: stamp, rotation vector and position of the world in the camera."""
    rows = [number_fields(fields, f"Line {number} of {path}") for number, fields in data_lines(path)]
    values = np.asarray([row for row in rows if np.isfinite(row).all()]).reshape(-1, 7)
    values = values[np.argsort(values[:, 0], kind="stable")]
    if len(values):
        check_position(values[:, 4:], str(path))
    poses = [pose_inverse(pose(rotation_exp(row[1:4]), row[4:])) for row in values]
    tell(
        "poses", f"{len(values)} of {len(rows)} lines, rotation vectors, world to camera (ARKitScenes)", path
    )
    return values[:, 0], np.asarray(poses).reshape(-1, 4, 4)


def _of_keys(path: Path, count: int, names: Sequence[str]) -> Array:
    """The poses of a ``transforms.json``, or of Record3D's ``metadata``: quaternion x y z w, position."""
    with read_keys(path) as keys:
        if keys.has("frames"):
            found = nerfstudio_poses(keys, path, names)
            return np.array([rigid(t, f"A transform_matrix of {path}") for t in found])
        if not keys.has("poses"):
            raise DataError(
                f"{path} has no poses that are known here (nerfstudio's 'frames', Record3D's 'poses'); write "
                "them as lines of stamp, x y z, qx qy qz qw (TUM)."
            )
        rows = np.asarray(keys.numbers("poses"))
        keys.leave("*", why="of the camera")
    if len(rows) % 7:
        raise DataError(f"The poses of {path} are not 7 numbers each; give Record3D's metadata.")
    poses = [pose_from_quaternion(r[4:], r[[3, 0, 1, 2]]) for r in rows.reshape(-1, 7)]
    return _one_a_frame(np.asarray(poses), count, f"{path} (Record3D)")

"""The package's own two-camera layout, EuRoC-like: reader and writer.

::

    recording.yaml              format: collabslam-recording, version: 1, name
    cam0/data/*.png  cam0/data.csv  cam0/sensor.yaml     Cs: every frame
    cam1/data/*.png  cam1/data.csv  cam1/sensor.yaml     Cf: only the frames where it was there
    relpose/data.csv            measured T_CF: ns, position, quaternion w x y z, 21 numbers
    groundtruth/data.csv        optional T_WC of Cs at frames' stamps: ns, position, quaternion w x y z

The 21 numbers are the lower triangle, row by row, of the 6x6 covariance of ``T_CF`` over (translation,
rotation), tangent on the right, m^2 and rad^2.  Stamps are integer nanoseconds; a view of Cf and its relative
pose belong to the frame of Cs whose stamp is the nearest within 5 ms.
"""

from __future__ import annotations

import itertools
import os
import shutil
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import yaml

from collabslam.datasets.calibration import load_camera, read_yaml, sensor_mapping
from collabslam.datasets.poses import (
    FARTHEST,
    NANOSECONDS,
    check_position,
    data_lines,
    interpolate_track,
    nanoseconds,
    number_fields,
    read_track,
    seconds,
)
from collabslam.datasets.readers.stamped import match_stamps, read_stream
from collabslam.datasets.recording import ImageRecording, RecordedView, RecordedWorn
from collabslam.errors import DataError
from collabslam.geometry import pose_from_quaternion, quaternion_wxyz
from collabslam.types import Array, Image, Recording, WornView

LAYOUT = "a two-camera recording (recording.yaml, cam0/, cam1/, relpose/data.csv)"
FORMAT = "collabslam-recording"
VERSION = 1
_TOLERANCE = 5_000_000
_TRIANGLE = np.tril_indices(6)
_POSE_COLUMNS = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z"
_QUATERNION_DECIMALS = 14


def matches(path: Path) -> bool:
    """Whether ``path`` is a two-camera recording."""
    return (path / "recording.yaml").is_file() or (path / "cam0" / "sensor.yaml").is_file()


# --- reading ----------------------------------------------------------------------------------


def _read_name(path: Path) -> str:
    header = path / "recording.yaml"
    if not header.is_file():
        return path.name
    content = read_yaml(header)
    if content.get("format") != FORMAT:
        raise DataError(f"{header} does not say 'format: {FORMAT}'; it is not a recording of this package.")
    if content.get("version") != VERSION:
        raise DataError(
            f"{header} is of version {content.get('version')}, this program reads version {VERSION}; "
            "update the program."
        )
    name = str(content.get("name", path.name))
    if not name or set(name) & set("/\\\0") or name.startswith("."):
        raise DataError(f"The name '{name}' in {header} is no name of a folder; results would go elsewhere.")
    return name


def _read_relative_poses(path: Path) -> tuple[list[int], list[tuple[Array, Array]]]:
    rows = []
    for number, fields in data_lines(path):
        where = f"Line {number} of {path}"
        if len(fields) != 29:
            raise DataError(
                f"{where} has {len(fields)} columns; 29 are needed: stamp, position, quaternion, 21 of "
                "the covariance."
            )
        values = np.asarray(number_fields(fields[1:], where))
        if not bool(np.all(np.isfinite(values))) or abs(float(np.linalg.norm(values[3:7])) - 1.0) > 1e-2:
            raise DataError(
                f"{where} holds no unit quaternion (w x y z) or a number that is not finite; correct it."
            )
        check_position(values[:3], where)
        if float(np.max(np.abs(values[7:]))) > FARTHEST:
            raise DataError(f"{where} has a covariance beyond all bounds; give m^2 and rad^2.")
        covariance = np.zeros((6, 6))
        covariance[_TRIANGLE] = values[7:]
        covariance = np.tril(covariance) + np.tril(covariance, -1).T
        scale = max(float(np.max(np.diag(covariance))), 0.0)
        if float(np.linalg.eigvalsh(covariance)[0]) < -1e-9 * scale:
            raise DataError(
                f"The covariance in line {number} of {path} is not positive semidefinite; correct it."
            )
        t_cf = pose_from_quaternion(values[:3], values[3:7])
        rows.append((nanoseconds(fields[0], where), (t_cf, covariance)))
    rows.sort(key=lambda row: row[0])
    return [s for s, _ in rows], [value for _, value in rows]


def _read_worn(path: Path, stamps: list[int], relative_poses: Path) -> RecordedWorn | None:
    folder = path / "cam1"
    if not folder.is_dir():
        return None
    view_stamps, paths = read_stream(folder)
    pose_stamps, poses = _read_relative_poses(relative_poses)
    views = match_stamps(stamps, view_stamps, _TOLERANCE)
    measured = match_stamps(stamps, pose_stamps, _TOLERANCE)
    both = sorted(set(views) & set(measured))
    if view_stamps and not both:
        raise DataError(
            f"No view in {folder} has a frame of cam0 and a row of {relative_poses} within 5 ms; "
            "put all three on the same clock."
        )
    found = {i: RecordedView(paths[views[i]], *poses[measured[i]]) for i in both}
    return RecordedWorn(load_camera(folder / "sensor.yaml"), found)


def open(path: Path, relative_poses: Path | None = None) -> ImageRecording:
    """Open a two-camera recording.

    Parameters
    ----------
    path : Path
    relative_poses : Path, optional
        Another file of measured ``T_CF`` in place of ``relpose/data.csv``.

    Raises
    ------
    DataError
        If a file is missing or broken, or the version is newer than this program.
    """
    name = _read_name(path)
    stamps, paths = read_stream(path / "cam0")
    times = np.asarray([seconds(s) for s in stamps])
    truth_file = path / "groundtruth" / "data.csv"
    truth = None
    if truth_file.is_file():
        truth = interpolate_track(*read_track(truth_file, euroc=True), times, widest=0.0)
    return ImageRecording(
        name=name,
        source=str(path),
        camera=load_camera(path / "cam0" / "sensor.yaml"),
        paths=tuple(paths),
        times=times,
        truth=truth,
        worn=_read_worn(path, stamps, relative_poses or path / "relpose" / "data.csv"),
    )


# --- writing ----------------------------------------------------------------------------------


def stable_quaternion(rotation: Array) -> list[float]:
    """Quaternion w x y z that comes out the same when its own rotation matrix is written again.

    Three parts are rounded to 14 decimals (1e-14 rad), far more coarsely than arithmetic disturbs them; the
    remaining one, which is not small, follows from the norm.
    """
    q = quaternion_wxyz(rotation)
    kept = int(np.flatnonzero(np.abs(q) >= 0.5 - 1e-9)[0])
    rounded = [round(float(x), _QUATERNION_DECIMALS) for x in q]
    rest = sum(x * x for k, x in enumerate(rounded) if k != kept)
    rounded[kept] = float(np.copysign(np.sqrt(max(1.0 - rest, 0.0)), q[kept]))
    leading = next(x for x in rounded if x != 0.0)
    return [(-x if leading < 0.0 else x) + 0.0 for x in rounded]


def _pose_fields(t: Array) -> list[str]:
    return [repr(float(x) + 0.0) for x in t[:3, 3]] + [repr(x) for x in stable_quaternion(t[:3, :3])]


def _write_lines(path: Path, header: str, lines: Iterable[str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8", newline="\n")


def _write_yaml(path: Path, content: dict[str, object]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
    path.write_text(text, encoding="utf-8", newline="\n")


def _write_image(folder: Path, stamp: int, image: Image) -> str:
    name = f"{stamp}.png"
    (folder / "data").mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(folder / "data" / name), image):
        raise DataError(
            f"The image {folder / 'data' / name} cannot be written; free disk space or change the folder."
        )
    return f"{stamp},{name}"


def _integer_stamps(times: Sequence[float] | Array) -> list[int]:
    stamps = [round(Fraction(float(t)) * NANOSECONDS) for t in times]
    if stamps and (stamps[0] < 0 or any(b <= a for a, b in itertools.pairwise(stamps))):
        raise DataError(
            "The time stamps are negative or closer than a nanosecond; give stamps in seconds that increase."
        )
    return stamps


def _relative_pose_line(stamp: int, worn: WornView) -> str:
    triangle = [repr(float(x) + 0.0) for x in np.asarray(worn.covariance, dtype=np.float64)[_TRIANGLE]]
    return ",".join([str(stamp), *_pose_fields(worn.t_cf), *triangle])


def _write_all(recording: Recording, folder: Path, progress: Callable[[int, int], None] | None) -> None:
    stamps = _integer_stamps(recording.times)
    _write_yaml(folder / "recording.yaml", {"format": FORMAT, "version": VERSION, "name": recording.name})
    _write_yaml(folder / "cam0" / "sensor.yaml", sensor_mapping(recording.camera))
    images, views, relative, truth = [], [], [], []
    for i, stamp in enumerate(stamps):
        frame = recording.frame(i)
        images.append(_write_image(folder / "cam0", stamp, frame.image))
        if frame.worn is not None:
            views.append(_write_image(folder / "cam1", stamp, frame.worn.image))
            relative.append(_relative_pose_line(stamp, frame.worn))
        if recording.truth is not None and bool(np.all(np.isfinite(recording.truth[i]))):
            truth.append(",".join([str(stamp), *_pose_fields(recording.truth[i])]))
        if progress is not None:
            progress(i + 1, len(stamps))
    _write_lines(folder / "cam0" / "data.csv", "#timestamp [ns],filename", images)
    if views and recording.worn_camera is not None:
        _write_yaml(folder / "cam1" / "sensor.yaml", sensor_mapping(recording.worn_camera))
        _write_lines(folder / "cam1" / "data.csv", "#timestamp [ns],filename", views)
        names = ",".join(f"c{r + 1}{c + 1}" for r, c in zip(*_TRIANGLE, strict=True))
        _write_lines(folder / "relpose" / "data.csv", f"{_POSE_COLUMNS},{names}", relative)
    if truth:
        _write_lines(folder / "groundtruth" / "data.csv", _POSE_COLUMNS, truth)


def write_recording(
    recording: Recording,
    out_dir: str | Path,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write any recording in this layout; reading it back gives the same frames.

    Images are lossless PNG.  Stamps are rounded to the nanosecond, rotations to 1e-14 rad; covariances are
    written in full.  Writing again what was read gives identical files.  A recording's target is not
    written.  The folder appears only when it is complete.

    Parameters
    ----------
    recording
        Any recording; its worn views and truth are written where it has them.
    out_dir
        New folder.
    overwrite
        Replace an earlier recording in this layout.
    progress
        Called with (frames done, frames in all).

    Returns
    -------
    Path
        ``out_dir``.

    Raises
    ------
    DataError
        If the folder exists (without ``overwrite``, or when it is not a recording), is or holds what the
        recording is read from, or cannot be written.
    """
    out = Path(out_dir)
    source = Path(recording.source).resolve()
    if source.exists() and source.is_relative_to(out.resolve()):
        raise DataError(
            f"The recording {source} would be destroyed by writing into {out}; give a folder apart from it."
        )
    occupied = out.exists() and not (out.is_dir() and not any(out.iterdir()))
    if occupied and not overwrite:
        raise DataError(f"The folder {out} exists already; give another one or ask to overwrite it.")
    if occupied and not (out / "recording.yaml").is_file():
        raise DataError(
            f"The folder {out} is no recording of this layout and is not overwritten; give another one."
        )
    partial = out.with_name(f".{out.name}.partial")
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        _write_all(recording, partial, progress)
        if out.exists():
            shutil.rmtree(out)
        os.replace(partial, out)
    except OSError as error:
        raise DataError(f"The folder {out} cannot be written ({error}); choose another place.") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return out

"""The package's own two-camera layout, EuRoC-like; `collabslam.RecordingWriter` writes it.

::

    recording.yaml              format: collabslam-recording, version, name
    cam0/data/*.png  cam0/data.csv  cam0/sensor.yaml     Cs: every frame
    cam1/data/*.png  cam1/data.csv  cam1/sensor.yaml     Cf: where it was there, at any time
    relpose/data.csv            measured T_CF: ns, position, quaternion w x y z, 21 or 42 numbers
    groundtruth/data.csv        optional T_WC of Cs at frames' stamps: ns, position, quaternion w x y z
    odometry/data.csv           optional: ns, vx vy vz (m/s), wx wy wz (rad/s), 21 numbers
    odometry/sensor.yaml        T_BC: 16 numbers, row by row; maps points of Cs into the odometry's frame
    imu0/data.csv               optional: ns, wx wy wz (rad/s) and maybe ax ay az (m/s^2)
    imu0/sensor.yaml            how that sits and how good it is, see `collabslam.datasets.imu.description`
    imu1/data.csv, sensor.yaml  optional: the same of Cf's own gyroscope; T_cam_imu maps into Cf

A camera's ``sensor.yaml`` may name an image of what is never scene, beside it: ``mask: mask.png`` (see
`collabslam.datasets.masks`).  That of a worn camera says ``body: false`` where nobody wears it: its views are
`WornView` with ``body=False``.

Version 2 is that of several persons, each with a camera.  `recording.yaml` then names them, as
``worn: [anna, ben]``, and each has a folder in place of ``cam1`` and ``relpose``::

    worn/anna/data/*.png  worn/anna/data.csv  worn/anna/sensor.yaml  worn/anna/relpose.csv  worn/anna/imu/

The 21 numbers are the lower triangle, row by row, of the 6x6 covariance of ``T_CF`` over (translation,
rotation), tangent on the right, m^2 and rad^2; 21 more are the part of it that lasts from frame to
frame, where that is known.  Those of odometry are of its twist's covariance, (m/s)^2 and (rad/s)^2.  Stamps
are integer nanoseconds.  A view of Cf comes with the first frame of Cs that is not more than 5 ms before it,
and is of its own time (METHOD section 21); its relative pose is the one whose stamp is the nearest within
5 ms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from collabslam.datasets.calibration import Calibration, load_camera, read_calibration
from collabslam.datasets.gate import data_lines, read_keys
from collabslam.datasets.images import read_grey
from collabslam.datasets.odometry import TRIANGLE, of_table
from collabslam.datasets.poses import (
    FARTHEST,
    interpolate_track,
    number_fields,
    read_pose_table,
    read_track,
    rigid,
)
from collabslam.datasets.printed_pose import with_printed_poses
from collabslam.datasets.readers.stamped import match_stamps, own_time, read_stream, views_of_frames
from collabslam.datasets.recorded_worn import RecordedWorn, WornImages
from collabslam.datasets.recording import ImageRecording
from collabslam.datasets.stream import StreamRecording
from collabslam.datasets.units import as_nanoseconds, as_seconds, read_stamps, seconds
from collabslam.errors import CollabslamError, DataError
from collabslam.targets.kinds import Board, Tag
from collabslam.types import Array, Odometry, WornView, person_name

LAYOUT = "a two-camera recording (recording.yaml, cam0/, cam1/, relpose/data.csv)"
FORMAT = "collabslam-recording"
VERSION, SEVERAL = 1, 2
"""Versions of the layout: of one worn camera, of several persons."""
_TOLERANCE = 5_000_000


def matches(path: Path) -> bool:
    """Whether ``path`` is a two-camera recording."""
    return (path / "recording.yaml").is_file() or (path / "cam0" / "sensor.yaml").is_file()


@dataclass(frozen=True)
class WornPlace:
    """Where a worn camera's files are: its images, their list and calibration; the measured T_CF."""

    folder: Path
    poses: Path


def worn_place(path: Path, name: str) -> WornPlace:
    """Of the worn camera of a person; of the only one if the name is empty."""
    if not name:
        return WornPlace(path / "cam1", path / "relpose" / "data.csv")
    folder = path / "worn" / name
    return WornPlace(folder, folder / "relpose.csv")


def _read_header(path: Path) -> tuple[str, list[str]]:
    """The recording's name, and those of the persons; a single "" where there is at most one camera."""
    header = path / "recording.yaml"
    if not header.is_file():
        return path.name, [""]
    with read_keys(header) as keys:
        if keys.take("format") != FORMAT:
            raise DataError(
                f"{header} does not say 'format: {FORMAT}'; it is not a recording of this package."
            )
        version = keys.take("version")
        if version not in (VERSION, SEVERAL):
            raise DataError(
                f"{header} is of version {version}, this program reads versions {VERSION} and {SEVERAL}; "
                "update the program."
            )
        name = keys.take("name")
        name = folder_name(path.name if name is None else str(name), DataError)
        persons = keys.take("worn") if version == SEVERAL else None
    if version == VERSION:
        return name, [""]
    if not isinstance(persons, list) or not persons or len(set(map(str, persons))) != len(persons):
        raise DataError(f"{header} names no persons; give each one's name once, as 'worn: [anna, ben]'.")
    return name, [person_name(person, DataError) for person in persons]


def folder_name(name: str, error: type[CollabslamError]) -> str:
    """A recording's name, of which result folders are called; raises ``error`` if it cannot be one."""
    if not name or set(name) & set("/\\\0") or name.startswith("."):
        raise error(f"The recording's name '{name}' is not a name of a folder; results would go elsewhere.")
    return name


def covariance_of(numbers: Array, where: str) -> Array:
    """A covariance (6, 6) of its lower triangle (21,)."""
    if float(np.max(np.abs(numbers))) > FARTHEST:
        raise DataError(f"{where} has a covariance beyond all bounds; give m^2 and rad^2.")
    covariance: Array = np.zeros((6, 6))
    covariance[TRIANGLE] = numbers
    covariance += np.tril(covariance, -1).T
    scale = max(float(np.max(np.diag(covariance))), 0.0)
    if float(np.linalg.eigvalsh(covariance)[0]) < -1e-9 * scale:
        raise DataError(f"{where} holds a covariance that is not positive semidefinite; correct it.")
    return covariance


def _read_relative_poses(path: Path) -> tuple[list[int], list[tuple[Array, Array, Array | None]]]:
    if not data_lines(path):  # a worn camera that is known, of which there is no view
        return [], []
    rows = read_pose_table(path, order="wxyz", further=(21, 42), usual="nanoseconds")
    measured = []
    for pose, numbers, line in zip(rows.poses, rows.further, rows.lines, strict=True):
        where = f"Line {line} of {path}"
        bias = covariance_of(numbers[21:], where) if len(numbers) > 21 else None
        measured.append((pose, covariance_of(numbers[:21], where), bias))
    return as_nanoseconds(rows.stamps), measured


def _read_worn(place: WornPlace, stamps: list[int]) -> RecordedWorn:
    folder, relative_poses = place.folder, place.poses
    view_stamps, paths = read_stream(folder)
    pose_stamps, poses = _read_relative_poses(relative_poses)
    measured = match_stamps(view_stamps, pose_stamps, _TOLERANCE)
    known = sorted(measured)
    of_frames = views_of_frames(stamps, [view_stamps[k] for k in known], _TOLERANCE)
    if view_stamps and not of_frames:
        raise DataError(
            f"No view in {folder} has a row of {relative_poses} within 5 ms, and a frame of cam0 after "
            "it; put all three on the same clock."
        )
    calibration, found = read_calibration(folder / "sensor.yaml"), {}
    for i, j in of_frames.items():
        k = known[j]
        own = own_time(view_stamps[k], stamps[i])
        found[i] = partial(_read_view, paths[k], calibration, poses[measured[k]], own)
    return RecordedWorn(calibration.camera, found)


def _read_view(
    path: Path, of: Calibration, pose: tuple[Array, Array, Array | None], t: float | None
) -> WornView:
    return WornView(read_grey(path, of.camera), *pose, t, body=of.body)


def _read_odometry(folder: Path) -> Odometry | None:
    """Odometry of the layout; None where there is none."""
    path = folder / "data.csv"
    if not path.is_file():
        return None
    sensor = folder / "sensor.yaml"
    with read_keys(sensor) as keys:
        t_bc = keys.numbers("T_BC", count=(16,))
    rows = data_lines(path)
    if not rows:
        raise DataError(f"{path} holds no odometry; remove it, or give one row for each sample.")
    numbers = []
    for number, texts in rows:
        where = f"Line {number} of {path}"
        if len(texts) != 28:
            raise DataError(f"{where} has {len(texts)} columns; 28 are needed: stamp, twist, covariance.")
        numbers.append(number_fields(texts[1:], where))
    texts, lines = [t[0] for _, t in rows], [n for n, _ in rows]
    stamps = as_seconds(read_stamps(texts, str(path), lines=lines, usual="nanoseconds"))
    pose = rigid(np.asarray(t_bc).reshape(4, 4), f"T_BC of {sensor}")
    return of_table(np.column_stack([stamps, np.asarray(numbers)]), pose, str(path))


def open(path: Path, relative_poses: Path | None = None) -> ImageRecording:
    """Open a two-camera recording.

    Parameters
    ----------
    path : Path
    relative_poses : Path, optional
        Another file of measured ``T_CF`` in place of the only worn camera's ``relpose/data.csv``.

    Raises
    ------
    DataError
        If a file is missing or broken, or the version is newer than this program.
    """
    base, stamps, persons = _robot(path)
    worn = {}
    for name in persons:
        place = worn_place(path, name)
        if name or place.folder.is_dir():
            poses = place.poses if relative_poses is None else relative_poses
            worn[name] = _read_worn(WornPlace(place.folder, poses), stamps)
    return replace(base, worn=worn)


def open_printed(path: Path, targets: list[Tag | Board]) -> StreamRecording:
    """Open a two-camera recording in which printed targets tell ``T_CF``; ``relpose/`` is not asked for.

    Raises
    ------
    DataError
        If a file is missing or broken, or there are no views of Cf.
    """
    base, stamps, persons = _robot(path)
    worn = {name: _images(worn_place(path, name).folder, stamps) for name in persons}
    stream = StreamRecording(
        base.name,
        base.source,
        base.camera,
        base.times,
        base.image,
        truth=base.truth,
        odometry=base.odometry,
    )
    return with_printed_poses(stream, worn, targets)


def _images(folder: Path, stamps: list[int]) -> WornImages:
    """A worn camera's images that were taken together with frames, whose stamps are given."""
    view_stamps, paths = read_stream(folder)
    camera = load_camera(folder / "sensor.yaml")
    views = match_stamps(stamps, view_stamps, _TOLERANCE)
    return camera, {i: partial(read_grey, paths[k], camera) for i, k in views.items()}


def _robot(path: Path) -> tuple[ImageRecording, list[int], list[str]]:
    """What there is of Cs, its stamps, nanoseconds, and the persons' names."""
    name, persons = _read_header(path)
    stamps, paths = read_stream(path / "cam0")
    times = np.asarray([seconds(s) for s in stamps])
    truth_file = path / "groundtruth" / "data.csv"
    truth = None
    if truth_file.is_file():
        truth = interpolate_track(*read_track(truth_file, euroc=True), times, widest=0.0)
    recording = ImageRecording(
        odometry=_read_odometry(path / "odometry"),
        name=name,
        source=str(path),
        camera=load_camera(path / "cam0" / "sensor.yaml"),
        paths=tuple(paths),
        times=times,
        truth=truth,
    )
    return recording, stamps, persons

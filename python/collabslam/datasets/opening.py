"""Opening a recording: the layout is recognised from the files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from collabslam.datasets.axes import with_t_cf_turned
from collabslam.datasets.calibration import load_camera
from collabslam.datasets.frame_poses import poses_of_frames
from collabslam.datasets.images import list_images, single_image
from collabslam.datasets.imu.beside import GyroGiven, Whose, WornGyroGiven, imu_log
from collabslam.datasets.imu.worn import with_worn_rates
from collabslam.datasets.masks import masks_beside
from collabslam.datasets.odometry import OdometryGiven, check_covers, read_odometry
from collabslam.datasets.ordered import DiskRecording, in_order
from collabslam.datasets.overrides import Given
from collabslam.datasets.printed_pose import printed_source
from collabslam.datasets.readers import (
    collab,
    davison,
    euroc,
    folder,
    kitti,
    posed_images,
    seven_scenes,
    tum_rgbd,
    video,
    videos,
)
from collabslam.datasets.recording import ImageRecording
from collabslam.datasets.ros import reader as bag_recording
from collabslam.datasets.ros.odometry_topic import read_odometry_topic
from collabslam.datasets.units import check_rate
from collabslam.errors import DataError, InputError
from collabslam.formats.files import check_name
from collabslam.types import Odometry


class Reader(NamedTuple):
    """A layout: its description, how it is recognised, how it is opened."""

    layout: str
    matches: Callable[[Path], bool]
    open: Callable[[Path, Given], DiskRecording]


_SHOWN = 4
"""Folders that are named."""
_AXES_OF = {"poses", "t_cf"}
"""What axes may be given of."""


def _complete(open_it: Callable[[Path], ImageRecording]) -> Callable[[Path, Given], DiskRecording]:
    """Opens a layout that is complete by itself, then puts in what the user gives."""

    def open_with(path: Path, given: Given) -> DiskRecording:
        recording = open_it(path)
        if given.camera is not None:
            recording = replace(recording, camera=load_camera(given.camera))
        if given.times is not None:
            stamps, paths = folder.read_times(given.times, list(recording.paths))
            if tuple(paths) != recording.paths:
                raise DataError(
                    f"{given.times} names other images than {recording.source} holds; give one stamp for "
                    "each image."
                )
            recording = replace(recording, times=stamps)
        return recording

    return open_with


def _two_cameras(path: Path, given: Given) -> DiskRecording:
    """The two-camera layout; printed targets may tell ``T_CF`` in place of its own list."""
    targets = printed_source(given.topics.get("t_cf"))
    if not targets:
        return _complete(collab.open)(path, given)
    if given.times is not None:
        raise DataError("Stamps from a file and t_cf=tag:... do not go together; leave --times out.")
    recording = collab.open_printed(path, targets)
    return recording if given.camera is None else replace(recording, camera=load_camera(given.camera))


_READERS = (
    Reader(euroc.LAYOUT, euroc.matches, _complete(euroc.open)),
    Reader(collab.LAYOUT, collab.matches, _two_cameras),
    *(
        Reader(module.LAYOUT, module.matches, _complete(module.open))
        for module in (seven_scenes, kitti, posed_images, davison)
    ),
    *(
        Reader(module.LAYOUT, module.matches, module.open)
        for module in (videos, tum_rgbd, bag_recording, video, folder)
    ),
)


def recognised_layouts() -> list[str]:
    """One line for each layout that is recognised, the generic folder last."""
    return [reader.layout for reader in _READERS]


def recognise(path: Path, given: Given) -> Reader:
    """The reader of a recording.

    Raises
    ------
    DataError
        If there is nothing, or no layout fits.
    """
    if not path.exists():
        raise DataError(f"The recording {path} does not exist; give the folder or the file of a recording.")
    for reader in _READERS:
        if reader.matches(path) and (reader.layout != folder.LAYOUT or given.camera is not None):
            return reader
    remedy = ""
    if all((path / name).is_file() for name in ("frames.csv", "summary.json")):
        raise DataError(
            f"{path} is what a run wrote, not a recording; 'collabslam doctor {path}' says how it went, a "
            "recording is run."
        )
    if path.is_file() and (said := single_image(path)) is not None:
        raise DataError(said)
    if folder.matches(path):
        list_images(folder.images_of(path) or path)  # says it where they are images that are not read
        remedy = f" 'collabslam init {path} --board 7x5:0.03' makes the calibration from a film of a board."
    inner = (
        sorted(p.name for p in path.iterdir() if p.is_dir() and folder.matches(p)) if path.is_dir() else []
    )
    if inner and not folder.matches(path):
        remedy = f" Its {'folders' if inner[1:] else 'folder'} {', '.join(inner[:_SHOWN])} "
        remedy += (
            f"{'hold' if inner[1:] else 'holds'} images: give one, as {path / inner[0]}, with --camera FILE."
        )
    raise DataError(
        f"The layout of {path} is not recognised; the known ones are: {'; '.join(recognised_layouts())}."
        f"{remedy}"
    )


def is_known(path: Path) -> bool:
    """Whether a recording is recognised without anything given beside it."""
    try:
        recognise(path.resolve(), Given())
    except DataError:
        return False
    return True


def open_recording(  # noqa: PLR0913 (each is an input of its own)
    source: str | Path,
    *,
    camera: str | Path | None = None,
    times: str | Path | None = None,
    poses: str | Path | None = None,
    topics: Mapping[str, str] | None = None,
    sensors: Iterable[OdometryGiven | GyroGiven] = (),
    depth_scale: float | None = None,
    axes: Mapping[str, str] | None = None,
    mask: str | Path | None = None,
) -> DiskRecording:
    """Open a recording; its layout is recognised from the files.

    Frames whose stamps repeat, go back or are far from all others are left out and counted as ``left_out``
    (see `collabslam.datasets.stamps.usable_frames`).

    Parameters
    ----------
    source
        Folder or file of the recording.
    camera
        Calibration file: needed where the recording has none, in place of its own otherwise.
    times
        Time stamps, one a line; their unit is found out.
    poses
        True trajectory of Cs, in TUM format or another that `poses_of_frames` names, used to emulate a worn
        camera and to score, never by the filter.
    topics
        Of a bag: the topic for each role, see `collabslam.datasets.ros.reader.ROLES`.
    sensors
        Odometry and gyroscope, in a file or a topic of the bag, in place of the recording's own; or that
        there is to be none. A `WornGyroGiven` is that of Cf.
    depth_scale
        Counts of a 16-bit depth image at one metre; the calibration's, 5000 of TUM RGB-D and 1000 of a bag
        unless told.
    axes
        Camera axes of the ``poses``, and of both sides of the measured ``t_cf``: ``optical`` (x right, y
        down, z forward), ``opengl`` (x right, y up, z back; ARKit, ARCore, Blender) or ``ros`` (x forward, y
        left, z up).
    mask
        Image of what is never scene in those of Cs, as the robot's own arm: black there, one other grey level
        elsewhere; in place of the one that the calibration names (key ``mask``).

    Raises
    ------
    DataError
        If the recording is missing, no layout fits, or a file is missing, broken or of the wrong size.
    InputError
        If topics, axes or sensors are something else.
    """
    _check_names(topics, axes)
    camera, times, poses, mask = (None if p is None else Path(p) for p in (camera, times, poses, mask))
    if depth_scale is not None and not 0.0 < depth_scale < math.inf:
        raise DataError(f"The depth scale is {depth_scale}; give counts at one metre, above zero.")
    given = Given(camera, times, poses, dict(topics or {}), None, depth_scale, dict(axes or {}), mask=mask)
    for one in _checked(sensors):
        given = _with_sensor(given, one)
    return open_given(Path(source), given)


def _with_sensor(given: Given, sensor: OdometryGiven | GyroGiven) -> Given:
    if isinstance(sensor, OdometryGiven):
        return replace(given, odometry=sensor)
    if isinstance(sensor, WornGyroGiven):
        return replace(given, worn_gyro=sensor)
    return replace(given, gyro=sensor)


def _checked(sensors: Iterable[OdometryGiven | GyroGiven]) -> list[OdometryGiven | GyroGiven]:
    found = list(sensors) if isinstance(sensors, Iterable) else [sensors]
    for one in found:
        if not isinstance(one, OdometryGiven | GyroGiven):
            raise InputError(
                f"A sensor is a {type(one).__name__}; give a list of OdometryGiven and GyroGiven."
            )
    return found


def _check_names(topics: Mapping[str, str] | None, axes: Mapping[str, str] | None) -> None:
    for what, given in (("topics", topics), ("axes", axes)):
        if given is not None and not isinstance(given, Mapping):
            raise InputError(f"The {what} are a {type(given).__name__}; give a mapping of names, or None.")
    if unknown := set(axes or {}) - _AXES_OF:
        named = ", ".join(sorted(map(str, unknown)))
        raise InputError(f"There are no axes of {named}; axes are given of {' and '.join(sorted(_AXES_OF))}.")


def open_given(path: Path, given: Given) -> DiskRecording:
    """As `open_recording`, with all that is given in one value."""
    check_name(path)
    path = path.resolve()
    recording = recognise(path, given).open(path, given)
    if given.poses is not None:
        names = [file.name for file in getattr(recording, "paths", ())]
        truth = poses_of_frames(given.poses, recording.times, given.axes.get("poses"), names)
        recording = replace(recording, truth=truth)
    recording = with_t_cf_turned(recording, given.axes.get("t_cf", "optical"))
    if given.odometry is not None:
        odometry = _odometry(path, given.odometry)
        check_covers(odometry, recording.times, given.odometry.source)
        recording = replace(recording, odometry=odometry)
    recording = _with_gyro(path, in_order(recording), given)
    recording = with_worn_rates(recording, path, given.worn_gyro, given.topics)
    recording = replace(recording, masks=masks_beside(recording, given))
    check_rate(recording.times, recording.source)
    recording.image(0)  # Says at once if the calibration is for another resolution.
    return recording


def _with_gyro(path: Path, recording: DiskRecording, given: Given) -> DiskRecording:
    """With the samples of the gyroscope that goes with it, if one does."""
    worn = None if given.worn_gyro is None else given.worn_gyro.source
    whose = Whose.cs(path, given.camera, not_topic=worn)
    log = imu_log(path, recording.times, recording.camera, given.gyro, whose, given.topics)
    return recording if log is None else replace(recording, imu=log)


def _odometry(path: Path, given: OdometryGiven) -> Odometry:
    """Odometry that is given beside the recording at ``path``."""
    file = Path(given.source)
    if file.is_file():
        return read_odometry(file, given)
    if bag_recording.matches(path):
        return read_odometry_topic(path, given)
    raise DataError(
        f"There is no file {file} with odometry, and {path} is not a bag with such a topic; give a CSV file: "
        "stamp, vx, vy, vz, wx, wy, wz."
    )

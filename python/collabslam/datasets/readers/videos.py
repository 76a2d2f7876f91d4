"""Videos with lists of stamps and poses beside them: what two phones, or any devices, can deliver.

::

    cam0.mp4  cam0.yaml  cam0.csv      Cs: video, calibration, and optionally the stamp of each frame
    cam1.mp4  cam1.yaml  cam1.csv      Cf: the same; left out where there is none
    t_cf.csv                           measured T_CF: stamp, position, quaternion w x y z, covariance
    truth.csv                          optional T_WC of Cs: stamp, position, quaternion w x y z

Of several persons each has a folder with what a Cf has, ``worn/anna/cam1.mp4``, ``cam1.yaml``, ``cam1.csv``
and ``t_cf.csv``, and is called as the folder is.

Videos may end in any of `video.SUFFIXES`.  Stamps are seconds or integer nanoseconds, on one clock; without a
list they are the container's.  The covariance of a row of ``t_cf.csv`` is two standard deviations, metres and
degrees, or 21 numbers as in `collab`.  A view of Cf comes with the first frame of Cs that is not more than
10 ms before it, and is of its own time (METHOD section 21); its pose is interpolated between two rows.  With
``t_cf=tag:...`` (see `printed_pose`) it needs no list, but a frame of Cs within 10 ms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.calibration import load_camera
from collabslam.datasets.overrides import Given
from collabslam.datasets.poses import (
    interpolate_track,
    read_pose_table,
)
from collabslam.datasets.printed_pose import printed_source, with_printed_poses
from collabslam.datasets.readers.collab import covariance_of
from collabslam.datasets.readers.stamped import match_stamps, own_time, views_of_frames
from collabslam.datasets.readers.video import SUFFIXES, Video, read_stamps
from collabslam.datasets.recorded_worn import RecordedWorn, WornImages
from collabslam.datasets.stream import StreamRecording
from collabslam.datasets.units import NANOSECONDS, as_seconds
from collabslam.errors import DataError
from collabslam.types import Array, WornView, person_name

LAYOUT = "two videos (cam0.mp4, cam0.yaml, cam1.mp4, cam1.yaml, t_cf.csv)"
_TOLERANCE = 10_000_000
Pair = Callable[[list[int], list[int], int], Mapping[int, int]]


def _video_of(path: Path, name: str) -> Path | None:
    """The video of that name, however its letters are written: cameras write CAM0.MP4."""
    wanted = [f"{name}{suffix}" for suffix in SUFFIXES]
    found = [p for p in path.iterdir() if p.name.lower() in wanted and p.is_file()]
    return min(found, key=lambda p: (wanted.index(p.name.lower()), p.name), default=None)


def matches(path: Path) -> bool:
    """Whether ``path`` is a folder with a video of Cs."""
    return path.is_dir() and _video_of(path, "cam0") is not None


def _read(path: Path, name: str, times: Path | None = None) -> tuple[Video, Array]:
    found = _video_of(path, name)
    assert found is not None
    video, listed = Video(found), times or path / f"{name}.csv"
    return video, read_stamps(listed, video) if listed.is_file() else video.times


def _lens(path: Path, name: str) -> Camera:
    sensor = path / f"{name}.yaml"
    if not sensor.is_file():
        raise DataError(
            f"The video {path / name} has no calibration; put {sensor} there ('collabslam init' makes one)."
        )
    return load_camera(sensor)


def _poses(path: Path, further: tuple[int, ...]) -> tuple[Array, Array, list[Array]]:
    """Stamps, poses and covariances of a list of poses, sorted by stamp."""
    rows = read_pose_table(path, order="wxyz", further=further)
    covariances = [
        _covariance(numbers, f"Line {line} of {path}")
        for numbers, line in zip(rows.further, rows.lines, strict=True)
        if len(numbers)
    ]
    return as_seconds(rows.stamps), np.asarray(rows.poses), covariances


def _covariance(numbers: Array, where: str) -> Array:
    if len(numbers) > 2:
        return covariance_of(numbers, where)
    if not (numbers > 0.0).all() or numbers[0] > 1e3 or numbers[1] > 180.0:
        raise DataError(f"{where} has impossible standard deviations; give metres and degrees above zero.")
    return np.diag(np.repeat([numbers[0], np.radians(numbers[1])], 3) ** 2)


def _nanoseconds(times: Array) -> list[int]:
    return [round(t * NANOSECONDS) for t in times.tolist()]


def open(path: Path, given: Given) -> StreamRecording:
    """Open two videos.

    Raises
    ------
    DataError
        If a video cannot be decoded, a calibration or a list is missing or broken, or nothing meets.
    """
    video, times = _read(path, "cam0", given.times)
    recording = StreamRecording(
        name=path.name,
        source=str(path),
        camera=load_camera(given.camera) if given.camera else _lens(path, "cam0"),
        times=times,
        read=video.read,
    )
    truth = path / "truth.csv"
    if truth.is_file():
        stamps, track, _ = _poses(truth, (0,))
        recording = replace(recording, truth=interpolate_track(stamps, track, times))
    folders = _persons(path)
    targets = printed_source(given.topics.get("t_cf"))
    if not folders:
        return recording
    if targets:
        images = {name: _images(recording, folder) for name, folder in folders.items()}
        return with_printed_poses(recording, images, targets)
    return replace(recording, worn={name: _worn(recording, folder) for name, folder in folders.items()})


def _persons(path: Path) -> dict[str, Path]:
    """Where the files of each Cf are, by name; those of a single one, "", are beside those of Cs."""
    alone = {"": path} if _video_of(path, "cam1") is not None else {}
    worn = path / "worn"
    if not worn.is_dir():
        return alone
    persons = {person_name(of.name, DataError): of for of in sorted(worn.iterdir()) if of.is_dir()}
    if alone and persons:
        raise DataError(
            f"{path} has cam1 and persons in {worn}, of whom each has a folder; move the files of cam1 into "
            "one there, too."
        )
    for folder in persons.values():
        if _video_of(folder, "cam1") is None:
            raise DataError(f"{folder} holds no video cam1 ({', '.join(SUFFIXES)}); put the person's there.")
    return alone or persons


def _images(recording: StreamRecording, folder: Path) -> WornImages:
    video, times = _read(folder, "cam1")
    together = _together(match_stamps, recording.times, times)
    return _lens(folder, "cam1"), {i: partial(video.read, k) for i, k in together.items()}


def _view(video: Video, k: int, t_cf: Array, covariance: Array, t: float | None) -> WornView:
    return WornView(video.read(k), t_cf, covariance, t=t)


def _worn(recording: StreamRecording, folder: Path) -> RecordedWorn:
    video, times = _read(folder, "cam1")
    poses = folder / "t_cf.csv"
    if not poses.is_file():
        raise DataError(
            f"The video {folder / 'cam1'} has no measured poses; put {poses} there (lines of "
            "stamp,x,y,z,qw,qx,qy,qz,sd_metres,sd_degrees), or give a printed target that both cameras "
            "see, as --topics t_cf=tag:36h11:3=0.16."
        )
    stamps, track, covariances = _poses(poses, (2, 21))
    views: dict[int, Callable[[], WornView]] = {}
    for frame, view in _together(views_of_frames, recording.times, times).items():
        t = times[view]
        t_cf = interpolate_track(stamps, track, np.asarray([t]))[0]
        own = own_time(*_nanoseconds(np.asarray([t, recording.times[frame]])))
        if np.isfinite(t_cf).all():
            covariance = covariances[int(np.argmin(np.abs(stamps - t)))]
            views[frame] = partial(_view, video, view, t_cf, covariance, own)
    if not views:
        raise DataError(
            f"No frame of cam1 in {folder} is between two rows of t_cf.csv, with one of cam0 after "
            "it; put all three on the same clock."
        )
    return RecordedWorn(_lens(folder, "cam1"), views)


def _together(pair: Pair, times: Array, others: Array) -> dict[int, int]:
    """Frames of Cs with the views that come with them, both by number in their videos."""
    frames, views = np.argsort(times), np.argsort(others)
    pairs = pair(_nanoseconds(times[frames]), _nanoseconds(others[views]), _TOLERANCE)
    return {int(frames[i]): int(views[k]) for i, k in pairs.items()}

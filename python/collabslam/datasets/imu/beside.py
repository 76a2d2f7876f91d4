"""The gyroscope that belongs to a recording: its own, or what is given beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.calibration import read_calibration
from collabslam.datasets.gate import tell
from collabslam.datasets.imu.description import MOUNTS, ImuFile, of_camera_file, read_imu_file
from collabslam.datasets.imu.files import Table, read_table
from collabslam.datasets.imu.log import checked
from collabslam.datasets.ros.bag import is_bag
from collabslam.datasets.ros.imu_topic import only_topic, read_imu_topic
from collabslam.errors import DataError
from collabslam.geometry import pose_inverse
from collabslam.types import Array, ImuLog

FOLDER = "imu0"
"""Where EuRoC's layout and our own have it, beside ``cam0``."""
NONE = "none"
LEAST_COVERED = 0.05
"""Share of the frames in the time of the samples below which they are of another time, or in another unit."""
_NO_GYRO = "--gyro none leaves the gyroscope out (--worn-gyro none that of Cf)"


@dataclass(frozen=True)
class GyroGiven:
    """A gyroscope that is given beside a recording.

    Attributes
    ----------
    source : str or None
        A file, a topic of a bag, ``none``, or None: the recording's own, if it has one.
    imu : str or None
        How it sits and how good it is: a file that `description` reads, or the name of its axes, one of
        `description.MOUNTS`.
    """

    source: str | None = None
    imu: str | None = None

    def description(self) -> ImuFile:
        """What is told of it; raises DataError if a file cannot be read."""
        if self.imu is None:
            return ImuFile()
        if self.imu in MOUNTS and not Path(self.imu).is_file():
            return ImuFile(r_ci=MOUNTS[self.imu])
        if not Path(self.imu).exists():
            raise DataError(
                f"There is no file {self.imu} and no axes of that name; give an imu.yaml, or one of "
                f"{', '.join(MOUNTS)}."
            )
        return read_imu_file(Path(self.imu))


@dataclass(frozen=True)
class WornGyroGiven(GyroGiven):
    """The same of the only worn camera's own gyroscope, along the axes of Cf unless ``imu`` tells others."""


def imu_log(
    path: Path,
    times: Array,
    camera: Camera,
    given: GyroGiven | None,
    *,
    calibration: Path | None = None,
    topics: Mapping[str, str] | None = None,
    worn: str | None = None,
) -> ImuLog | None:
    """The samples that go with a recording; None where it has none, or none are wanted.

    Parameters
    ----------
    path : Path
        The recording.
    times : (N,) array
        Of its frames, seconds.
    camera : Camera
        Cs.
    given : GyroGiven or None
    calibration : Path, optional
        A calibration of Cs that is given, which may tell of the sensor, too.
    topics : mapping, optional
        Topics of a bag by role.
    worn : str, optional
        The topic of Cf's own gyroscope, which is not that of Cs.

    Raises
    ------
    DataError
        If what is given cannot be used, or shares no time with the frames.
    """
    given = given or GyroGiven()
    if given.source == NONE:
        return None
    told = given.description()
    if calibration is not None:
        told = told.over(of_camera_file(calibration))
    if given.source is None:
        own = path / FOLDER, path / "mav0" / FOLDER
        folder = next((f for f in own if (f / "data.csv").is_file()), None)
        if folder is not None:
            return _of_folder(folder, path, times, told, calibration, asked=False)
        topic = only_topic(path, worn) if is_bag(path) else None
        if topic is not None:
            told = _placed(told, path, calibration)
            return _of_topic(path, topic, times, told, topics or {}, "cs", asked=False)
        if given.imu is not None:
            raise DataError(f"{path} has no gyroscope that --imu could tell of; give --gyro FILE|TOPIC.")
        return None
    file = Path(given.source)
    folder = file if file.is_dir() else file.parent
    if (folder / "data.csv").is_file() and (folder / "sensor.yaml").is_file():
        return _of_folder(folder, path, times, told, calibration, asked=True)
    return named_log(path, given.source, times, camera, _placed(told, path, calibration), topics or {}, "cs")


def worn_imu_log(
    path: Path,
    times: Array,
    camera: Camera,
    given: GyroGiven,
    folder: Path,
    *,
    topics: Mapping[str, str],
) -> ImuLog | None:
    """The samples of a worn camera's own gyroscope, as `imu_log` gives those of Cs, along the axes of F.

    Parameters
    ----------
    path : Path
        The recording.
    times : (N,) array
        Of the camera's views, seconds.
    camera : Camera
        Cf.
    given : GyroGiven
    folder : Path
        Where the recording has its own, if it has.
    topics : mapping
        Topics of a bag by role.

    Raises
    ------
    DataError
        As `imu_log`; T_BS of EuRoC tells nothing here.
    """
    if given.source == NONE:
        return None
    told = replace(given.description(), t_bs=None)
    if given.source is not None:
        return named_log(path, given.source, times, camera, told, topics, "cf")
    if (folder / "data.csv").is_file():
        return _of_folder(folder, path, times, told, None, asked=False)
    if given.imu is not None:
        raise DataError(
            f"{path} has no gyroscope of Cf that --worn-imu could tell of; give --worn-gyro FILE|TOPIC."
        )
    return None


def named_log(
    path: Path,
    source: str,
    times: Array,
    camera: Camera,
    told: ImuFile,
    topics: Mapping[str, str],
    whose: str,
) -> ImuLog | None:
    """A file, or a topic of the bag at ``path``; ``whose`` is the role of the images that it goes with."""
    file = Path(source)
    if file.is_file():
        return _of_table(read_table(file), times, camera, told, str(file), whose)
    if is_bag(path):
        return _of_topic(path, source, times, told, topics, whose, asked=True)
    raise DataError(
        f"There is no file {file} with a gyroscope's samples, and {path} is not a bag with such a topic; "
        "give a CSV file: stamp, wx, wy, wz (rad/s)."
    )


def _placed(told: ImuFile, path: Path, calibration: Path | None) -> ImuFile:
    """With the mount in C, where only that in the body is told (EuRoC's T_BS); raises DataError if nothing
    tells how the camera sits there."""
    if told.r_ci is not None or told.t_bs is None:
        return told
    own = (path / "cam0" / "sensor.yaml", path / "mav0" / "cam0" / "sensor.yaml")
    for file in (calibration, *own):
        if file is not None and file.is_file():
            camera_t_bs = read_calibration(file).t_bs
            if camera_t_bs is not None:
                return replace(told, r_ci=(pose_inverse(camera_t_bs) @ told.t_bs)[:3, :3])
    raise DataError(
        f"T_BS tells how the gyroscope sits in a body, and nothing tells how the camera of {path} sits "
        f"there; give T_cam_imu, or axes, in --imu. {_NO_GYRO}."
    )


def _of_folder(
    folder: Path, path: Path, times: Array, told: ImuFile, calibration: Path | None, *, asked: bool
) -> ImuLog | None:
    """A sensor in EuRoC's layout; None if nothing tells how it sits and nobody has ``asked`` for it."""
    data, sensor = folder / "data.csv", folder / "sensor.yaml"
    if sensor.is_file():
        told = told.over(read_imu_file(sensor))
    try:
        told = _placed(told, path, calibration)
    except DataError:
        if asked:
            raise
    if told.r_ci is None:
        tell("passed over", "gyroscope (nothing tells how it sits to the camera; give --imu)", data)
        return None
    table = read_table(data, "nanoseconds")
    return _checked(table, table.clocks, times, told, told.r_ci, str(data))


def _of_table(table: Table, times: Array, camera: Camera, told: ImuFile, where: str, whose: str) -> ImuLog:
    r_ci = told.r_ci
    if r_ci is None and table.phone:
        if camera.width > camera.height:
            raise DataError(
                f"{where} is a phone's log, and the pictures are wide: say where the phone's top pointed, "
                "with --imu phone-left or --imu phone-right (collabslam check-calib tells whether it fits)."
            )
        r_ci = MOUNTS["opengl"]
        tell("axes of the gyroscope", "those of a phone held upright", where)
    elif r_ci is None:
        r_ci = np.eye(3)
        of = "Cs (--imu tells others)" if whose == "cs" else "Cf (--worn-imu tells others)"
        tell("axes of the gyroscope", f"those of {of}", where)
    return _checked(table, table.clocks, times, told, r_ci, where)


def _of_topic(
    bag: Path, topic: str, times: Array, told: ImuFile, topics: Mapping[str, str], whose: str, *, asked: bool
) -> ImuLog | None:
    where = f"{topic} of {bag}"
    found = read_imu_topic(bag, topic, topics.get(whose), asked=asked)
    if found is None:
        return None
    r_ci = found.r_ci if told.r_ci is None else told.r_ci
    if r_ci is None:
        why = f"tf does not link its frame {found.frame!r} to that of the images; give --imu"
        if not asked:
            tell("passed over", f"gyroscope ({why})", where)
            return None
        raise DataError(f"Nothing tells how the gyroscope of {where} sits: {why} imu.yaml, or --imu ros.")
    return _checked(found.table, found.table.clocks, times, told, r_ci, where)


def _checked(
    table: Table, clocks: list[Array], times: Array, told: ImuFile, r_ci: Array, where: str
) -> ImuLog:
    """The samples by the first of their clocks that the frames share."""
    sensor = told.sensor(r_ci)
    spans = []
    for stamps in clocks:
        on_frames = stamps[np.isfinite(stamps)] + sensor.time_offset
        if not on_frames.size:
            continue
        within = (times >= on_frames.min()) & (times <= on_frames.max())
        if within.mean() >= LEAST_COVERED:
            if not within.all():
                tell("gyroscope", f"covers {int(within.sum())} of {len(times)} frames", where)
            return checked(stamps, table.rates, table.accelerations, sensor, where)
        spans.append(f"{on_frames.min():.3f} to {on_frames.max():.3f} s")
    raise DataError(
        f"The samples of {where} ({'; '.join(spans) or 'none'}) and the frames ({times[0]:.3f} to "
        f"{times[-1]:.3f} s) share no time, or next to none; put both on one clock, in seconds, or tell "
        "timeshift_cam_imu in --imu. "
        f"{_NO_GYRO}."
    )

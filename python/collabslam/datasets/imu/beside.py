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


@dataclass(frozen=True)
class Whose:
    """Whose gyroscope is asked for.

    Attributes
    ----------
    role : str
        Of its camera's images among the topics of a bag: ``cs`` or ``cf``.
    gyro, imu : str
        The options that give it.
    folders : tuple of Path
        Where the recording may have it, in EuRoC's layout.
    calibration : Path or None
        A calibration of the camera that is given, which may tell of the sensor, too.
    cameras : tuple of Path
        Files that tell how the camera sits in EuRoC's body.
    not_topic : str or None
        A topic of a bag that is another one's.
    """

    role: str
    gyro: str
    imu: str
    folders: tuple[Path, ...]
    calibration: Path | None = None
    cameras: tuple[Path, ...] = ()
    not_topic: str | None = None

    @classmethod
    def cs(cls, path: Path, calibration: Path | None, not_topic: str | None) -> Whose:
        """That of Cs."""
        places = path, path / "mav0"
        own = tuple(place / "cam0" / "sensor.yaml" for place in places)
        cameras = own if calibration is None else (calibration, *own)
        folders = tuple(place / FOLDER for place in places)
        return cls("cs", "--gyro", "--imu", folders, calibration, cameras, not_topic)

    @classmethod
    def cf(cls, folder: Path) -> Whose:
        """A worn camera's own; EuRoC's T_BS tells nothing of it."""
        return cls("cf", "--worn-gyro", "--worn-imu", (folder,))


def imu_log(
    path: Path,
    times: Array,
    camera: Camera,
    given: GyroGiven | None,
    whose: Whose,
    topics: Mapping[str, str],
) -> ImuLog | None:
    """The samples that go with a camera's images; None where it has none, or none are wanted.

    Parameters
    ----------
    path : Path
        The recording.
    times : (N,) array
        Of the images, seconds.
    camera : Camera
    given : GyroGiven or None
    whose : Whose
    topics : mapping
        Topics of a bag by role.

    Raises
    ------
    DataError
        If what is given cannot be used, or shares no time with the images.
    """
    given = given or GyroGiven()
    if given.source == NONE:
        return None
    told = given.description()
    if whose.calibration is not None:
        told = told.over(of_camera_file(whose.calibration))
    if given.source is not None:
        return _named(path, given.source, times, camera, told, whose, topics)
    folder = next((f for f in whose.folders if (f / "data.csv").is_file()), None)
    if folder is not None:
        return _of_folder(folder, path, times, told, whose, asked=False)
    topic = only_topic(path, whose.not_topic) if whose.role == "cs" and is_bag(path) else None
    if topic is not None:
        return _of_topic(path, topic, times, _placed(told, path, whose), whose, topics, asked=False)
    if given.imu is not None:
        of = "" if whose.role == "cs" else " of Cf"
        raise DataError(
            f"{path} has no gyroscope{of} that {whose.imu} could tell of; give {whose.gyro} FILE|TOPIC."
        )
    return None


def _named(
    path: Path,
    source: str,
    times: Array,
    camera: Camera,
    told: ImuFile,
    whose: Whose,
    topics: Mapping[str, str],
) -> ImuLog | None:
    """A file, a folder in EuRoC's layout, or a topic of the bag at ``path``."""
    file = Path(source)
    folder = file if file.is_dir() else file.parent
    if (folder / "data.csv").is_file() and (folder / "sensor.yaml").is_file():
        return _of_folder(folder, path, times, told, whose, asked=True)
    told = _placed(told, path, whose)
    if file.is_file():
        return _of_table(read_table(file), times, camera, told, str(file), whose)
    if is_bag(path):
        return _of_topic(path, source, times, told, whose, topics, asked=True)
    raise DataError(
        f"There is no file {file} with a gyroscope's samples, and {path} is not a bag with such a topic; "
        "give a CSV file: stamp, wx, wy, wz (rad/s)."
    )


def _placed(told: ImuFile, path: Path, whose: Whose) -> ImuFile:
    """With the mount at the camera, where only that in the body is told (EuRoC's T_BS); raises DataError if
    nothing tells how the camera sits there."""
    if told.r_ci is not None or told.t_bs is None or whose.role == "cf":
        return replace(told, t_bs=None)
    for file in whose.cameras:
        if file.is_file():
            camera_t_bs = read_calibration(file).t_bs
            if camera_t_bs is not None:
                return replace(told, r_ci=(pose_inverse(camera_t_bs) @ told.t_bs)[:3, :3])
    raise DataError(
        f"T_BS tells how the gyroscope sits in a body, and nothing tells how the camera of {path} sits "
        f"there; give T_cam_imu, or axes, in --imu. {_NO_GYRO}."
    )


def _of_folder(
    folder: Path, path: Path, times: Array, told: ImuFile, whose: Whose, *, asked: bool
) -> ImuLog | None:
    """A sensor in EuRoC's layout; None if nothing tells how it sits and nobody has ``asked`` for it."""
    data, sensor = folder / "data.csv", folder / "sensor.yaml"
    if sensor.is_file():
        told = told.over(read_imu_file(sensor))
    try:
        told = _placed(told, path, whose)
    except DataError:
        if asked:
            raise
    if told.r_ci is None:
        tell("passed over", f"gyroscope (nothing tells how it sits to the camera; give {whose.imu})", data)
        return None
    table = read_table(data, "nanoseconds")
    return _checked(table, table.clocks, times, told, told.r_ci, str(data))


def _of_table(table: Table, times: Array, camera: Camera, told: ImuFile, where: str, whose: Whose) -> ImuLog:
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
        tell("axes of the gyroscope", f"those of {whose.role.title()} ({whose.imu} tells others)", where)
    return _checked(table, table.clocks, times, told, r_ci, where)


def _of_topic(
    bag: Path,
    topic: str,
    times: Array,
    told: ImuFile,
    whose: Whose,
    topics: Mapping[str, str],
    *,
    asked: bool,
) -> ImuLog | None:
    where = f"{topic} of {bag}"
    found = read_imu_topic(bag, topic, topics.get(whose.role), asked=asked)
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

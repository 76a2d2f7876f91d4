"""Writing the package's own two-camera layout (see `collabslam.datasets.readers.collab`), frame by frame."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import ArrayLike

from collabslam._core import Camera, Filter
from collabslam.datasets.calibration import sensor_mapping
from collabslam.datasets.imu import description
from collabslam.datasets.imu.beside import FOLDER as IMU_FOLDER
from collabslam.datasets.imu.worn import place_of as worn_imu_place
from collabslam.datasets.odometry import TRIANGLE
from collabslam.datasets.readers.collab import FORMAT, SEVERAL, VERSION, folder_name, worn_place
from collabslam.datasets.units import NANOSECONDS
from collabslam.datasets.written_numbers import (
    array_of,
    checked_covariance,
    checked_pose,
    following_stamp,
    pose_fields,
    whole_nanoseconds,
)
from collabslam.errors import DataError, InputError
from collabslam.formats.files import LineFile, write_text
from collabslam.formats.partial_folder import PartialFolder
from collabslam.images import check_grey, check_masks
from collabslam.types import (
    Array,
    Image,
    Imu,
    ImuLog,
    Mask,
    Odometry,
    Recording,
    WornView,
    masks_of,
    person_name,
    worn_cameras,
)

_MASK = "mask.png"
_POSE_COLUMNS = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z"
_IMAGE_COLUMNS = "#timestamp [ns],filename"
_TWIST_COLUMNS = "#timestamp [ns],v_x [m/s],v_y,v_z,w_x [rad/s],w_y,w_z"
_RATE_COLUMNS = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1]"
_FORCE_COLUMNS = "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
_TRIANGLE_COLUMNS = ",".join(f"c{r + 1}{c + 1}" for r, c in zip(*TRIANGLE, strict=True))


class RecordingWriter:
    """Writes images, stamps and poses as a recording that `collabslam.open_recording` reads.

    Used in a ``with`` block, or closed by hand.  Images are lossless PNG.  Until it is closed the folder has
    a name ``.NAME.RANDOM.partial`` beside its place; closing gives it its own, also where an error or Ctrl-C
    has ended the block: what was added until then is a whole recording.

    Parameters
    ----------
    folder : str or Path
        New folder.
    camera : Camera
        Cs.
    worn_camera : Camera or dict of Camera, optional
        Cf; needed for frames with a worn view.  Of several persons each one's by a name, which
        `WornView.who` tells.
    name : str, optional
        Of the recording; the folder's unless told.
    overwrite : bool
        Replace an earlier recording in this layout.
    t_bc : (4, 4) array, optional
        Where Cs sits in the frame B of `add_odometry`: maps points of C into B, metres; B is C if left out.
    imu : Imu, optional
        The sensor of `add_gyro`: how it sits and how good it is; along the axes of Cs if left out.
    mask, worn_mask
        What is never scene in the images of Cs and Cf, as in `collabslam.Slam`.

    Raises
    ------
    InputError
        If a camera is no `Camera`, ``t_bc`` no pose, a mask not one of its camera's images, or a
        name is not a name of a folder.
    DataError
        If the folder exists (without ``overwrite``, or when it is not a recording), or cannot be written.
    """

    def __init__(  # noqa: PLR0913 (each is an input of its own)
        self,
        folder: str | Path,
        camera: Camera,
        worn_camera: Camera | Mapping[str, Camera] | None = None,
        *,
        name: str | None = None,
        overwrite: bool = False,
        t_bc: ArrayLike | None = None,
        imu: Imu | None = None,
        mask: Mask | Image | None = None,
        worn_mask: Mask | Image | Mapping[str, Mask | Image] | None = None,
    ) -> None:
        cameras = _named(worn_camera)
        for lens in (camera, *cameras.values()):
            if not isinstance(lens, Camera):
                raise InputError(
                    f"The camera is a {type(lens).__name__}; give a collabslam.Camera, which load_camera "
                    "reads from a calibration file."
                )
        self._masks = check_masks(camera, cameras, mask, worn_mask)
        self._out = _free(Path(folder), overwrite)
        self._camera, self._worn_cameras = camera, cameras
        self._lists: dict[Path, LineFile] = {}
        self._last = self._last_odometry = self._last_gyro = -1
        self._last_worn_gyro: dict[str, int] = {}
        self._views: set[tuple[str, int]] = set()
        self._bodies: dict[str, bool] = {}
        self._t_bc = np.eye(4) if t_bc is None else checked_pose(t_bc, "T_BC")
        self._imu, self._forces = Imu(np.eye(3)) if imu is None else imu, False
        self._frames = 0
        self._open = True
        title = folder_name(self._out.resolve().name if name is None else name, InputError)
        with self._writable():
            self._folder = PartialFolder(self._out)
            self._partial = self._folder.path
            (self._partial / "cam0" / "data").mkdir(parents=True)
            header: dict[str, object] = {"format": FORMAT, "version": VERSION, "name": title}
            if any(cameras):
                header.update(version=SEVERAL, worn=list(cameras))
                for person in cameras:
                    self._begin_worn(person)
            _write_yaml(self._partial / "recording.yaml", header)
            self._write_sensor(self._partial / "cam0", camera, self._masks.robot)

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None or self._frames:
            self.close()
        else:
            self.discard()

    def __len__(self) -> int:
        return self._frames

    def add(
        self,
        t: float,
        image: Image,
        views: Sequence[WornView] = (),
        truth: ArrayLike | None = None,
    ) -> None:
        """Adds a frame.  What is refused leaves the recording as it was.

        Parameters
        ----------
        t : float
            Time stamp, seconds, not negative; kept to the nanosecond, and later than the last one.
        image : (H, W) uint8
            Grey image of Cs; `collabslam.to_grey` makes one of any other.
        views : sequence of WornView, optional
            At most one of each worn camera, at the same instant or, with its time, of another one.  Read back
            it comes with the first frame from its time on, whenever it arrived here.  Its ``rate`` is not
            written: that is what the samples of `add_worn_gyro` tell.
        truth : (4, 4) array, optional
            True ``T_WC`` of Cs, for scores only.

        Raises
        ------
        InputError
            For a stamp that does not follow, a time of a view that was written before, an image of the wrong
            type or size, a pose that is none, a covariance that is none, a worn view without its
            ``worn_camera``, or one whose ``body`` is not that of the same camera's views before.
        DataError
            If the disk is full.
        """
        if not self._open:
            raise InputError("The recording is closed; begin another one, in another folder.")
        stamp = following_stamp(t, self._last)
        image = check_grey(image, self._camera, "image")
        if not isinstance(views, Sequence):
            raise InputError(f"The views are {type(views).__name__}; give a list of WornView.")
        checked = {(view.who, self._taken(view, stamp)): self._checked(view) for view in views}
        if len(checked) < len(views):
            raise InputError("A worn view is given twice; give one of each person.")
        true = None if truth is None else checked_pose(truth, "truth")
        with self._writable():
            # The lists last, so that they name nothing that is not there.
            name = self._write_image(self._partial / "cam0", stamp, image)
            for view in views:
                self._begin_worn(view.who, body=view.body)
            for (who, taken), parts in checked.items():
                self._write_view(who, taken, *parts)
            self._views.update(checked)
            if true is not None:
                line = ",".join([str(stamp), *pose_fields(true)])
                self._append(self._partial / "groundtruth" / "data.csv", _POSE_COLUMNS, line)
            self._append(self._partial / "cam0" / "data.csv", _IMAGE_COLUMNS, f"{stamp},{name}")
        self._last = stamp
        self._frames += 1

    def add_odometry(self, t: float, twist: ArrayLike, covariance: ArrayLike) -> None:
        """Adds a sample of odometry, in any order with the frames.  What is refused leaves all as it was.

        Parameters
        ----------
        t : float
            Stamp, seconds, not negative, later than the last sample's; by the clock of the frames.
        twist : (6,) array
            As for `collabslam.Slam.add_odometry`, m/s and rad/s.
        covariance : (6, 6) array
            Of it.

        Raises
        ------
        InputError
            For what `collabslam.Slam.add_odometry` refuses.
        DataError
            If the disk is full.
        """
        if not self._open:
            raise InputError("The recording is closed; begin another one, in another folder.")
        stamp = following_stamp(t, self._last_odometry)
        moved, spread = array_of(twist, (6,), "twist"), array_of(covariance, (6, 6), "covariance")
        Filter.check_odometry(moved, spread)
        fields = [repr(float(x) + 0.0) for x in (*moved, *spread[TRIANGLE])]
        with self._writable():
            sensor = self._partial / "odometry" / "sensor.yaml"
            if not sensor.exists():
                sensor.parent.mkdir()
                _write_yaml(sensor, {"T_BC": [float(x) for x in self._t_bc.ravel()]})
            line = ",".join([str(stamp), *fields])
            self._append(sensor.parent / "data.csv", f"{_TWIST_COLUMNS},{_TRIANGLE_COLUMNS}", line)
        self._last_odometry = stamp

    def add_gyro(self, t: float, rate: ArrayLike, acceleration: ArrayLike | None = None) -> None:
        """Adds a sample of the gyroscope, in any order with the frames; what is refused changes nothing.

        Parameters
        ----------
        t : float
            Stamp, seconds, not negative, later than the last sample's; by the sensor's clock.
        rate : (3,) array
            As for `collabslam.Slam.add_gyro`, rad/s.
        acceleration : (3,) array, optional
            As for `collabslam.Slam.add_acceleration`, m/s^2; with all samples or with none, NaN where one
            has none.

        Raises
        ------
        InputError
            For wrong shapes, what `collabslam.Slam.add_gyro` refuses, or a stamp that does not follow.
        DataError
            If the disk is full.
        """
        if not self._open:
            raise InputError("The recording is closed; begin another one, in another folder.")
        stamp = following_stamp(t, self._last_gyro)
        turning = array_of(rate, (3,), "rate")
        Filter.check_gyro(turning)
        numbers = list(turning)
        forces, first = acceleration is not None, self._last_gyro < 0
        if not first and forces is not self._forces:
            raise InputError("Some samples have an acceleration and some have none; give NaN where it lacks.")
        if acceleration is not None:
            numbers += list(array_of(acceleration, (3,), "acceleration", finite=False))
        with self._writable():
            folder = self._partial / IMU_FOLDER
            if first:
                folder.mkdir()
                _write_yaml(folder / "sensor.yaml", description.mapping(self._imu))
            self._forces = forces
            header = f"{_RATE_COLUMNS},{_FORCE_COLUMNS}" if forces else _RATE_COLUMNS
            line = ",".join([str(stamp), *(repr(float(x) + 0.0) for x in numbers)])
            self._append(folder / "data.csv", header, line)
        self._last_gyro = stamp

    def add_worn_gyro(self, t: float, rate: ArrayLike, who: str = "") -> None:
        """Adds a sample of a worn camera's own gyroscope, in any order with the frames and its views.

        Parameters
        ----------
        t : float
            Stamp, seconds, not negative, later than the last sample's; by the clock of the frames.
        rate : (3,) array
            Angular velocity along the axes of Cf, rad/s.
        who : str
            Whose it is, of several persons.

        Raises
        ------
        InputError
            For a wrong shape, an impossible rate, a stamp that does not follow, or a worn camera that is not
            there; nothing changes then.
        DataError
            If the disk is full.
        """
        if not self._open:
            raise InputError("The recording is closed; begin another one, in another folder.")
        if who not in self._worn_cameras:
            raise InputError(f"There is no worn camera {who!r}; give the writer its calibration.")
        before = self._last_worn_gyro.get(who, -1)
        stamp = following_stamp(t, before)
        turning = array_of(rate, (3,), "rate")
        Filter.check_gyro(turning)
        with self._writable():
            folder = worn_imu_place(self._partial, who)
            if before < 0:
                folder.mkdir(parents=True)
                _write_yaml(folder / "sensor.yaml", description.mapping(Imu(np.eye(3))))
            line = ",".join([str(stamp), *(repr(float(x) + 0.0) for x in turning)])
            self._append(folder / "data.csv", _RATE_COLUMNS, line)
        self._last_worn_gyro[who] = stamp

    def close(self) -> None:
        """Gives the folder its name; raises DataError if there is no frame, or the name cannot be taken."""
        if not self._open:
            return
        if not self._frames:
            self.discard()
            raise DataError(f"The recording {self._out} has no frames; add one before it is closed.")
        self._release()
        with self._writable():
            self._folder.take_place()

    def discard(self) -> None:
        """Removes what was written; an earlier recording that was to be replaced stays."""
        if self._open:
            self._release()
            self._folder.discard()

    def _release(self) -> None:
        self._open = False
        for file in self._lists.values():
            file.close()

    @contextlib.contextmanager
    def _writable(self) -> Any:
        try:
            yield
        except OSError as error:
            raise DataError(
                f"The folder {self._out} cannot be written ({error.strerror}); free disk space or choose "
                "another place."
            ) from error

    def _taken(self, worn: WornView, frame: int) -> int:
        """When a view that comes with a frame was taken, nanoseconds."""
        taken = frame if worn.t is None else whole_nanoseconds(worn.t)
        if (worn.who, taken) in self._views:
            raise InputError(
                f"There is a worn view of {taken / NANOSECONDS} s already; give each one once, with its time."
            )
        return taken

    def _checked(self, worn: WornView) -> tuple[Image, Array, list[Array]]:
        """Image, T_CF, its covariance and, where it is known, the part of that which lasts."""
        camera = self._worn_cameras.get(worn.who)
        if camera is None:
            whose = f" of {worn.who!r}" if worn.who or self._worn_cameras else ""
            raise InputError(
                f"There is a worn view{whose} but no worn_camera; give the writer the calibration of Cf."
            )
        image = check_grey(worn.image, camera, "worn image")
        if self._bodies.get(worn.who, worn.body) is not worn.body:
            whose = f" of {worn.who!r}" if worn.who else ""
            raise InputError(
                f"Somebody wears the camera{whose} in some of its views and nobody in others; give all of "
                "them the same WornView.body."
            )
        covariances = [checked_covariance(worn.covariance, "covariance of T_CF")]
        if worn.bias is not None:
            covariances.append(checked_covariance(worn.bias, "bias of T_CF"))
        return image, checked_pose(worn.t_cf, "T_CF"), covariances

    def _begin_worn(self, who: str, *, body: bool | None = None) -> None:
        """The folder of a worn camera: its lists, its calibration, which says ``body`` once a view tells."""
        place = worn_place(self._partial, who)
        begun = place.folder.exists()
        if not begun:
            (place.folder / "data").mkdir(parents=True)
        if not begun or (body is not None and who not in self._bodies):
            mask = self._masks.worn.get(who)
            self._write_sensor(place.folder, self._worn_cameras[who], mask, body=body is not False)
        if body is not None:
            self._bodies[who] = body
        if not begun:
            self._begin(place.poses, f"{_POSE_COLUMNS},{_TRIANGLE_COLUMNS}")
            self._begin(place.folder / "data.csv", _IMAGE_COLUMNS)

    def _write_sensor(self, folder: Path, camera: Camera, mask: Mask | None, *, body: bool = True) -> None:
        content = sensor_mapping(camera)
        if not body:
            content["body"] = False
        if mask is not None:
            content["mask"] = _MASK
            if not cv2.imwrite(str(folder / _MASK), 255 * mask.astype(np.uint8)):
                raise DataError(f"The mask {folder / _MASK} cannot be written; free disk space.")
        _write_yaml(folder / "sensor.yaml", content)

    def _write_view(self, who: str, stamp: int, image: Image, t_cf: Array, covariances: list[Array]) -> None:
        place = worn_place(self._partial, who)
        name = self._write_image(place.folder, stamp, image)
        triangles = [repr(float(x) + 0.0) for c in covariances for x in c[TRIANGLE]]
        line = ",".join([str(stamp), *pose_fields(t_cf), *triangles])
        self._lists[place.poses].append(line)
        self._lists[place.folder / "data.csv"].append(f"{stamp},{name}")

    def _write_image(self, folder: Path, stamp: int, image: Image) -> str:
        name = f"{stamp}.png"
        path = folder / "data" / name
        if not cv2.imwrite(str(path), image):
            raise DataError(f"The image {path} cannot be written; free disk space or change the folder.")
        return name

    def _append(self, path: Path, header: str, line: str) -> None:
        if path not in self._lists:
            self._begin(path, header)
        self._lists[path].append(line)

    def _begin(self, path: Path, header: str) -> None:
        write_text(path, f"{header}\n")
        self._lists[path] = LineFile(path)


def write_recording(
    recording: Recording,
    out_dir: str | Path,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write any recording in the package's own layout; reading it back gives the same frames.

    Stamps are rounded to the nanosecond, rotations to 1e-14 rad; covariances are written in full.  Writing
    again what was read gives identical files.  A recording's target is not written.  The folder appears only
    when it is complete.

    Parameters
    ----------
    recording
        Any recording; its worn views, odometry, gyroscope and truth are written where it has them.
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
    InputError
        If a frame holds what `RecordingWriter.add` refuses.
    """
    out, source = Path(out_dir), Path(recording.source).resolve()
    if source.exists() and source.is_relative_to(out.resolve()):
        raise DataError(
            f"The recording {source} would be destroyed by writing into {out}; give a folder apart from it."
        )
    odometry: Odometry | None = getattr(recording, "odometry", None)
    log = _from_zero(getattr(recording, "imu", None))
    writer = RecordingWriter(
        out,
        recording.camera,
        worn_cameras(recording),
        name=recording.name,
        overwrite=overwrite,
        t_bc=None if odometry is None else odometry.t_bc,
        imu=None if log is None else log.sensor,
        mask=masks_of(recording).robot,
        worn_mask=masks_of(recording).worn,
    )
    try:
        if log is not None:
            forces = log.accelerations if log.accelerations is not None else [None] * len(log)
            for t, rate, force in zip(log.times.tolist(), log.rates, forces, strict=True):
                writer.add_gyro(t, rate, force)
        for who, own in getattr(recording, "worn_imu", {}).items():
            if who not in worn_cameras(recording):
                continue
            for t, rate in zip((own.times + own.sensor.time_offset).tolist(), own.rates, strict=True):
                if t >= 0.0:
                    writer.add_worn_gyro(t, own.sensor.r_ci @ rate, who)
        if odometry is not None:
            rows = zip(odometry.times.tolist(), odometry.twists, odometry.covariances, strict=True)
            for t, twist, covariance in rows:
                writer.add_odometry(t, twist, covariance)
        for i, t in enumerate(recording.times.tolist()):
            frame = recording.frame(i)
            true = None if recording.truth is None else recording.truth[i]
            known = true is not None and bool(np.isfinite(true).all())
            writer.add(t, frame.image, frame.views, true if known else None)
            if progress is not None:
                progress(i + 1, len(recording))
        writer.close()
    finally:
        writer.discard()
    return out


def _from_zero(log: ImuLog | None) -> ImuLog | None:
    """The same samples by a clock whose stamps are not negative, whole seconds ahead of their own."""
    if log is None or log.times[0] >= 0.0:
        return log
    ahead = float(np.ceil(-log.times[0]))
    sensor = replace(log.sensor, time_offset=log.sensor.time_offset - ahead)
    return replace(log, times=log.times + ahead, sensor=sensor)


def _named(worn_camera: Camera | Mapping[str, Camera] | None) -> dict[str, Camera]:
    """The worn cameras by name, "" that of a single one; raises InputError if folders cannot be named so."""
    if worn_camera is None:
        return {}
    cameras = dict(worn_camera) if isinstance(worn_camera, Mapping) else {"": worn_camera}
    for name in cameras if list(cameras) != [""] else ():
        person_name(name, InputError)
    return cameras


def _free(out: Path, overwrite: bool) -> Path:
    """The place of a new recording; raises DataError if something is there that is not to be replaced."""
    occupied = out.exists() and not (out.is_dir() and not any(out.iterdir()))
    if occupied and not overwrite:
        raise DataError(f"The folder {out} exists already; give another one or ask to overwrite it.")
    if occupied and not (out / "recording.yaml").is_file():
        raise DataError(
            f"The folder {out} is not a recording of this layout and is not overwritten; give another one."
        )
    return out


def _write_yaml(path: Path, content: dict[str, object]) -> None:
    write_text(path, yaml.safe_dump(content, sort_keys=False, default_flow_style=None))

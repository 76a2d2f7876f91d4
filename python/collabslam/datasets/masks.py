"""What is never scene in a recording's images: masks that are given beside it, or that its calibrations name.

A calibration file has the key ``mask``, the name of an image beside it.  Black is what is
never scene, and there is one other grey level.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from collabslam._core import Camera
from collabslam.datasets.calibration import read_calibration
from collabslam.datasets.gate import tell
from collabslam.datasets.images import decode_grey
from collabslam.datasets.ordered import DiskRecording
from collabslam.datasets.overrides import Given
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import DataError, InputError, SettingsError
from collabslam.images import check_mask
from collabslam.types import Mask, Masks, Recording, masks_of, worn_cameras

_OF_ROBOT = ("cam0/sensor.yaml", "mav0/cam0/sensor.yaml", "cam0.yaml")
_OF_ONLY_WORN = ("cam1/sensor.yaml", "cam1.yaml")
"""Where layouts have the calibrations of their cameras."""


def read_mask(path: Path, camera: Camera, whose: str) -> Mask:
    """A mask's file as (H, W) bool, True where there may be scene.

    Parameters
    ----------
    path : Path
    camera : Camera
        Whose images it is for.
    whose : str
        The camera, for whoever listens to what is read.

    Raises
    ------
    DataError
        If it is missing, broken, of another size, has more than two grey levels, or leaves hardly anything.
    """
    try:
        scene = check_mask(decode_grey(path, camera), camera, f"mask {path}")
    except InputError as error:
        raise DataError(str(error)) from error
    tell(f"mask of {whose}", f"leaves {100.0 * float(scene.mean()):.0f} % of the image", path)
    return scene


def masks_beside(recording: DiskRecording, given: Given) -> Masks:
    """The masks of a recording: of Cs as it is given or as its calibration names it, of Cf as theirs do."""
    path = Path(recording.source)
    robot = given.mask
    if robot is None:
        robot = _named(path, _OF_ROBOT) if given.camera is None else _of_file(given.camera, given)
    worn = {}
    for name, camera in recording.worn_cameras.items():
        files = (f"worn/{name}/sensor.yaml",) if name else _OF_ONLY_WORN
        if (named := _named(path, files)) is not None:
            worn[name] = read_mask(named, camera, "Cf")
    return Masks(None if robot is None else read_mask(robot, recording.camera, "Cs"), worn)


def _named(folder: Path, files: tuple[str, ...]) -> Path | None:
    """The mask that the first of these files that exists names."""
    file = next((folder / name for name in files if (folder / name).is_file()), None)
    return None if file is None else read_calibration(file).mask


def _of_file(calibration: Path, given: Given) -> Path | None:
    return read_calibration(calibration, topic=given.topics.get("cs", "")).mask


class WithWornMasks(WrappedRecording):
    """A recording with masks of its worn cameras, which are given beside it.

    Parameters
    ----------
    base : Recording
    files : mapping of Path
        By the name of whoever wears the camera.

    Raises
    ------
    SettingsError
        If there is no such worn camera.
    DataError
        As `read_mask`.
    """

    def __init__(self, base: Recording, files: Mapping[str, Path]) -> None:
        super().__init__(base)
        cameras, masks = worn_cameras(base), masks_of(base)
        if missing := [name for name in files if name not in cameras]:
            known = ", ".join(map(repr, cameras)) or "nobody"
            raise SettingsError(
                f"{base.name} has no worn camera of {', '.join(map(repr, missing))} whose mask is given; "
                f"there are those of {known}."
            )
        read = {name: read_mask(file, cameras[name], "Cf") for name, file in files.items()}
        self.masks = Masks(masks.robot, {**masks.worn, **read})

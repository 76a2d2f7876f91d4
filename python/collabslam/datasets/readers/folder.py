"""A plain folder of images with a calibration file: the layout for one's own recordings.

Images lie in the folder itself or in its subfolder ``images``.  Their times come from a file (one stamp a
line, in the order of the image names; a second column may name the image), from names that are times since
1970, or from the key ``rate`` (frames per second) of the calibration file.
"""

from __future__ import annotations

from pathlib import Path

from collabslam.datasets.calibration import Calibration, of_stamped, read_calibration
from collabslam.datasets.gate import data_lines, is_number, leave_columns
from collabslam.datasets.images import IMAGE_SUFFIXES, list_images, require_files, unread_images
from collabslam.datasets.overrides import Given
from collabslam.datasets.recording import ImageRecording, stamps_in_names, times_at_rate
from collabslam.datasets.units import as_seconds, listed_stamps
from collabslam.errors import DataError
from collabslam.types import Array

LAYOUT = "a folder of images with --camera CAMERA.yaml"


def images_of(path: Path) -> Path | None:
    """The folder that holds the images, or None; else one of images that are not read."""
    folders = [folder for folder in (path, path / "images") if folder.is_dir()]
    for folder in folders:
        if any(p.suffix.lower() in IMAGE_SUFFIXES for p in folder.iterdir()):
            return folder
    return next((folder for folder in folders if unread_images(folder)), None)


def read_times(times: Path, paths: list[Path]) -> tuple[Array, list[Path]]:
    """Stamps of a times file and the images they belong to.

    Raises
    ------
    DataError
        If counts disagree, a named image is missing, or a stamp is not a number.
    """
    rows = data_lines(times)
    if rows and all(len(f) == 2 and Path(f[0]).suffix.lower() in IMAGE_SUFFIXES for _, f in rows):
        rows = [(n, fields[::-1]) for n, fields in rows]
    stamps, further = listed_stamps(rows, str(times))
    named = bool(further) and all(more and not is_number(more[0]) for more in further)
    leave_columns(further, int(named), f"{times}, behind the stamps")
    if named:
        paths = [paths[0].parent / Path(more[0]).name for more in further]
        require_files(paths)
    elif len(stamps) != len(paths):
        raise DataError(
            f"{times} has {len(stamps)} stamps for {len(paths)} images; give one for each image in the "
            "order of names."
        )
    return as_seconds(stamps), paths


def _stamps(paths: list[Path], calibration: Calibration, camera: Path) -> Array:
    stamps = stamps_in_names(paths)
    if stamps is not None:
        of_stamped(calibration, camera)
        return stamps
    if calibration.rate is not None:
        return times_at_rate(paths, calibration.rate)
    raise DataError(
        f"The images of {paths[0].parent} carry no time stamps; give --times FILE with one stamp a line, "
        f"or the key 'rate' (frames per second) in {camera}."
    )


def matches(path: Path) -> bool:
    """Whether ``path`` is a folder of images."""
    return images_of(path) is not None


def open(path: Path, given: Given) -> ImageRecording:
    """Open a folder of images; ``given.camera`` is needed.

    Raises
    ------
    DataError
        If an image, a stamp or the calibration is missing or broken.
    """
    camera = given.camera
    assert camera is not None
    paths = list_images(images_of(path) or path)
    calibration = read_calibration(camera)
    if given.times is not None:
        stamps, paths = read_times(given.times, paths)
        of_stamped(calibration, camera)
    else:
        stamps = _stamps(paths, calibration, camera)
    return ImageRecording(
        name=path.name,
        source=str(path),
        camera=calibration.camera,
        paths=tuple(paths),
        times=stamps,
    )

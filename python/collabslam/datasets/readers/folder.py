"""A plain folder of images with a calibration file: the layout for one's own recordings.

Images lie in the folder itself or in its subfolder ``images``.  Their times come from a file (one stamp a
line, seconds or integer nanoseconds, in the order of the image names; a second column may name the image),
from names that are nanoseconds since 1970, or from the key ``rate`` (frames per second) of the calibration
file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam.datasets.calibration import camera_from_mapping, read_yaml
from collabslam.datasets.images import IMAGE_SUFFIXES, list_images, require_files
from collabslam.datasets.overrides import Given
from collabslam.datasets.poses import data_lines, interpolate_track, parse_stamp, read_track, seconds
from collabslam.datasets.recording import ImageRecording, times_at_rate
from collabslam.errors import DataError
from collabslam.types import Array

LAYOUT = "a folder of images with --camera CAMERA.yaml"
_NANOSECOND_DIGITS = (18, 19)


def images_of(path: Path) -> Path | None:
    """The folder that holds the images, or None."""
    for folder in (path, path / "images"):
        if folder.is_dir() and any(p.suffix.lower() in IMAGE_SUFFIXES for p in folder.iterdir()):
            return folder
    return None


def read_times(times: Path, paths: list[Path]) -> tuple[Array, list[Path]]:
    """Stamps of a times file and the images they belong to.

    Raises
    ------
    DataError
        If counts disagree, a named image is missing, or a stamp is no number.
    """
    lines = data_lines(times)
    stamps = np.asarray([parse_stamp(f[0], f"line {n} of {times}") for n, f in lines])
    if lines and all(len(f) > 1 for _, f in lines):
        paths = [paths[0].parent / Path(f[1]).name for _, f in lines]
        require_files(paths)
    elif len(lines) != len(paths):
        raise DataError(
            f"{times} has {len(lines)} stamps for {len(paths)} images; give one for each image in the "
            "order of names."
        )
    return stamps, paths


def _stamps(paths: list[Path], rate: object, camera: Path) -> Array:
    if rate is not None:
        try:
            hertz = float(rate)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            hertz = 0.0
        if not (np.isfinite(hertz) and hertz > 0.0):
            raise DataError(f"The key 'rate' of {camera} is not a positive number; give frames per second.")
        return times_at_rate(paths, hertz)
    if all(p.stem.isdigit() and len(p.stem) in _NANOSECOND_DIGITS for p in paths):
        return np.asarray([seconds(int(p.stem)) for p in paths])
    raise DataError(
        f"The images of {paths[0].parent} carry no time stamps; give --times FILE with one stamp a line, "
        "or the key "
        f"'rate' (frames per second) in {camera}."
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
    content = read_yaml(camera)
    if given.times is not None:
        stamps, paths = read_times(given.times, paths)
    else:
        stamps = _stamps(paths, content.get("rate"), camera)
    return ImageRecording(
        name=path.name,
        source=str(path),
        camera=camera_from_mapping(content, camera),
        paths=tuple(paths),
        times=stamps,
    )


def track_truth(poses: Path, times: Array) -> Array:
    """Poses of a TUM file at the frames' times, (N, 4, 4) with NaN where it says nothing.

    Raises
    ------
    DataError
        If the two share no time at all.
    """
    stamps, track = read_track(poses)
    truth = interpolate_track(stamps, track, times)
    if not bool(np.any(np.isfinite(truth))):
        raise DataError(
            f"The poses of {poses} ({stamps[0]:.3f} to {stamps[-1]:.3f} s) and the images ({times[0]:.3f} to "
            f"{times[-1]:.3f} s) share no time; give both in the same clock."
        )
    return truth

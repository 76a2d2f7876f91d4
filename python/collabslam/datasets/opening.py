"""Opening a recording: the layout is recognised from the files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from collabslam.datasets import collab, davison, euroc, folder, kitti, posed_images, seven_scenes
from collabslam.datasets.base import ImageRecording
from collabslam.datasets.calibration import load_camera
from collabslam.errors import DataError


class _Reader(NamedTuple):
    layout: str
    matches: Callable[[Path], bool]
    open: Callable[[Path], ImageRecording]


_READERS = tuple(
    _Reader(module.LAYOUT, module.matches, module.open)
    for module in (euroc, collab, seven_scenes, kitti, posed_images, davison)
)


def recognised_layouts() -> list[str]:
    """One line for each layout that is recognised, the generic folder last."""
    return [reader.layout for reader in _READERS] + [folder.LAYOUT]


def _with_overrides(
    recording: ImageRecording, camera: Path | None, times: Path | None, poses: Path | None
) -> ImageRecording:
    """A recording of a known layout with the user's own calibration, stamps or poses in place of its own."""
    if camera is not None:
        recording = replace(recording, camera=load_camera(camera))
    if times is not None:
        stamps, paths = folder.read_times(times, list(recording.paths))
        if tuple(paths) != recording.paths:
            raise DataError(
                f"{times} names other images than {recording.source} holds; give one stamp for each image."
            )
        recording = replace(recording, times=stamps)
    if poses is not None:
        recording = replace(recording, truth=folder.track_truth(poses, recording.times))
    return recording


def open_recording(
    source: str | Path, *, camera: Path | None = None, times: Path | None = None, poses: Path | None = None
) -> ImageRecording:
    """Open a recording; its layout is recognised from the files.

    Parameters
    ----------
    source
        Folder of the recording.
    camera
        Calibration file: needed for a plain folder of images, in place of the recording's own otherwise.
    times
        Time stamps, one a line, seconds or integer nanoseconds.
    poses
        True trajectory of Cs in TUM format, used to emulate a worn camera and to score, never by the filter.

    Raises
    ------
    DataError
        If the folder is missing, no layout fits, or a file is missing, broken or of the wrong size.
    """
    path = Path(source)
    if not path.is_dir():
        kind = "is a file" if path.exists() else "does not exist"
        raise DataError(f"The recording {path} {kind}; give the folder of a recording.")
    path = path.resolve()
    camera, times, poses = (None if p is None else Path(p) for p in (camera, times, poses))
    for reader in _READERS:
        if reader.matches(path):
            recording = _with_overrides(reader.open(path), camera, times, poses)
            break
    else:
        if camera is None or folder.images_of(path) is None:
            raise DataError(
                f"The layout of {path} is not recognised; the known ones are: "
                f"{'; '.join(recognised_layouts())}."
            )
        recording = folder.open(path, camera, times, poses)
    recording.image(0)  # Says at once if the calibration is for another resolution.
    return recording

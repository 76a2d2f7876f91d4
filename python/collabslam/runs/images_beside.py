"""The images of a run's poses, written beside them for tools that want both."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2

from collabslam.datasets.stamps import usable_frames
from collabslam.errors import DataError
from collabslam.formats.files import read_bytes, write_bytes
from collabslam.types import Recording

IMAGES = "images"


def image_names(indices: Sequence[int]) -> list[str]:
    """Names of the images of these frames, where there are none beside them."""
    return [f"{index:06d}.png" for index in indices]


def write_images(folder: Path, recording: Recording, indices: Sequence[int]) -> list[str]:
    """Write the images of a run's frames into a folder.

    Files of the recording are copied as they are, in colour where they are; others become grey PNGs.

    Parameters
    ----------
    folder : Path
        New.
    recording : Recording
        That of the run.
    indices : sequence of int
        Of its usable frames.

    Returns
    -------
    list of str
        Their names.

    Raises
    ------
    DataError
        If the recording has not so many frames, or a file cannot be read or written.
    """
    usable, _ = usable_frames(recording.times)
    if indices and max(indices) >= len(usable):
        raise DataError(
            f"{recording.name} has {len(usable)} usable frames and the run had more; give the run's own."
        )
    paths: Sequence[Path] | None = getattr(recording, "paths", None)
    folder.mkdir()
    names = image_names(indices)
    for k, index in enumerate(indices):
        i = int(usable[index])
        if paths is None:
            write_bytes(folder / names[k], cv2.imencode(".png", recording.image(i))[1].tobytes())
        else:
            names[k] = str(Path(names[k]).with_suffix(paths[i].suffix))
            write_bytes(folder / names[k], read_bytes(paths[i]))
    return names

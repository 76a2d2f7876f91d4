"""A run as a model for reconstruction tools: camera, poses, points, and images where they are asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from collabslam.errors import DataError
from collabslam.formats.colmap import write_colmap
from collabslam.formats.nerfstudio import write_transforms
from collabslam.formats.partial_folder import PartialFolder
from collabslam.geometry import pose, pose_inverse
from collabslam.results import Landmarks
from collabslam.runs.images_beside import IMAGES, image_names, write_images
from collabslam.runs.run_folder import RunFolder
from collabslam.types import Array, Recording


def write_model(
    run: RunFolder, out: Path, kind: str, *, level: bool = False, recording: Recording | None = None
) -> tuple[int, int]:
    """Write a COLMAP model into ``sparse/0`` of a folder, or nerfstudio's files; images into ``images``.

    Parameters
    ----------
    run : RunFolder
    out : Path
        New folder.
    kind : str
        ``colmap``, ``colmap-text`` or ``nerfstudio``.
    level : bool
        In the level world; else in that of the start. In both as loops correct poses and points.
    recording : Recording, optional
        The run's, whose images go there.

    Returns
    -------
    (int, int)
        How many poses and points.

    Raises
    ------
    DataError
        If a file of the run is missing or broken, the format knows no such lens, or the folder cannot be
        written.
    """
    camera, indices = run.camera(), run.valid_indices()
    poses, points = _corrected(run)
    if level:
        poses, points = _levelled(run, poses, points)
    if len(indices) != len(poses):
        raise DataError(
            f"{run.path} has {len(poses)} poses for {len(indices)} valid frames; run the recording again."
        )
    try:
        folder = PartialFolder(out)
    except OSError as error:
        raise DataError(
            f"The folder {out} cannot be written ({error.strerror}); give another one."
        ) from error
    try:
        place = folder.path
        names = (
            image_names(indices) if recording is None else write_images(place / IMAGES, recording, indices)
        )
        if kind == "nerfstudio":
            write_transforms(place, camera, [f"{IMAGES}/{name}" for name in names], poses, points)
        else:
            model = place / "sparse" / "0"
            write_colmap(model, camera, names, poses, points, text=kind == "colmap-text")
        folder.take_place()
    finally:
        folder.discard()
    return len(poses), len(points.ids)


def _corrected(run: RunFolder) -> tuple[Array, Landmarks]:
    """Poses and all landmarks as loops correct them: those of the submaps, and what the filter has beyond."""
    poses, points = run.trajectory()[1], run.landmarks()
    corrected, whole = run.corrected(), run.whole_map()
    if corrected is None or whole is None or not len(poses):
        return poses, points
    moved = corrected[-1] @ pose_inverse(poses[-1])
    turn, new = moved[:3, :3], ~np.isin(points.ids, whole.ids)
    return corrected, Landmarks(
        np.concatenate([whole.ids, points.ids[new]]),
        np.concatenate([whole.points, points.points[new] @ turn.T + moved[:3, 3]]),
        np.concatenate([whole.covariance, turn @ points.covariance[new] @ turn.T]),
    )


def _levelled(run: RunFolder, poses: Array, points: Landmarks) -> tuple[Array, Landmarks]:
    """The same in the run's level world."""
    r_lw = run.r_lw()
    moved = Landmarks(points.ids, points.points @ r_lw.T, r_lw @ points.covariance @ r_lw.T)
    return pose(r_lw, np.zeros(3)) @ poses, moved

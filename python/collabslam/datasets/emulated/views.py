"""Posed views of the same place, from which a worn camera's views can be taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.emulated.view_overlap import grid_points, view_overlap
from collabslam.datasets.opening import open_recording
from collabslam.datasets.recording import ImageRecording
from collabslam.errors import DataError
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Recording

LONGEST_RUN = 5
LEAST_OVERLAP = 0.15


@dataclass(frozen=True)
class PosedViews:
    """Images with true poses in a recording's own world.

    Attributes
    ----------
    camera : Camera
    paths : sequence of image files
    poses : (N, 4, 4) float64
        ``T_WF``, NaN where it is missing.
    stamps : (N,) float64 or None
        Seconds in the recording's own clock, or None: views of its own time span are left out by them.
    """

    camera: Camera
    paths: Sequence[Path]
    poses: Array
    stamps: Array | None


def load_views(recording: Recording, folder: str) -> PosedViews:
    """Posed views of a folder, given relative to the recording's source or as an absolute path.

    The folder is any recording with a truth in the same world.

    Raises
    ------
    DataError
        If the folder is missing or its images have no poses.
    """
    path = Path(recording.source) / folder
    if not path.is_dir():
        raise DataError(
            f"There is no folder {path}; views:FOLDER lies in the recording, or is given as an absolute path."
        )
    other = open_recording(path)
    if not isinstance(other, ImageRecording) or other.truth is None:
        raise DataError(
            f"The views in {path} have no poses; give a folder whose images are posed in the same world."
        )
    if not bool(np.any(np.isfinite(other.truth))):
        raise DataError(f"None of the views in {path} has a pose; give poses in the recording's own clock.")
    return PosedViews(other.camera, other.paths, other.truth, None)


def choose_views(
    recording: Recording, views: PosedViews, wanted: Sequence[bool]
) -> dict[int, tuple[int, Array]]:
    """The view with the largest overlap for each wanted frame.

    Views of the recording's own time span are left out.  A view serves at most 5 frames running and then
    rests for 5, so that one picture does not stand for a whole block.

    Parameters
    ----------
    recording
        Needs its truth.
    views
        Candidates.
    wanted
        Per frame, whether the worn camera is there.

    Returns
    -------
    Mapping of frame index to (index of the view, true ``T_CF`` (4, 4)); frames without enough overlap are
    missing.
    """
    truth = recording.truth
    assert truth is not None
    usable = np.all(np.isfinite(views.poses), axis=(1, 2))
    if views.stamps is not None:
        usable &= (views.stamps < recording.times[0]) | (views.stamps > recording.times[-1])
    candidates = [int(j) for j in np.flatnonzero(usable)]
    points = grid_points(recording.camera)
    chosen: dict[int, tuple[int, Array]] = {}
    current, run, resting = -1, 0, dict[int, int]()
    for i in range(len(recording)):
        if not wanted[i] or not bool(np.all(np.isfinite(truth[i]))):
            continue
        t_cw = pose_inverse(truth[i])
        best, most = -1, LEAST_OVERLAP
        for j in candidates:
            if resting.get(j, -1) < i:
                share = view_overlap(points, views.camera, t_cw @ views.poses[j])
                if share > most:
                    best, most = j, share
        if best < 0:
            current, run = -1, 0
            continue
        run = run + 1 if best == current else 1
        current = best
        if run == LONGEST_RUN:
            resting[best] = i + LONGEST_RUN
        chosen[i] = (best, t_cw @ views.poses[best])
    return chosen

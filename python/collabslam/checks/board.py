"""Poses of the worn camera from a board that both cameras see, for `worn_pose.calibrate_person`."""

from __future__ import annotations

import contextlib

import numpy as np

from collabslam.datasets.persons import check_alone
from collabslam.datasets.wrapped import Together
from collabslam.errors import DataError, InputError
from collabslam.targets.kinds import Board
from collabslam.targets.printed import pose_between
from collabslam.types import Array, Recording


def board_poses(recording: Recording, board: Board) -> tuple[Array, Array]:
    """`pose_between` of each of a recording's frames.

    Parameters
    ----------
    recording : Recording
        With a worn camera; its own poses are not used.
    board : Board

    Returns
    -------
    (N, 4, 4), (N, 6, 6) float64
        Poses and covariances of all frames; NaN where both cameras do not see the board whole, or their
        images were not taken together.

    Raises
    ------
    InputError
        If there is no worn camera, or the board looks the same upside down.
    SettingsError
        If there are several.
    """
    check_alone(recording)
    count, worn_camera = len(recording), recording.worn_camera
    if worn_camera is None:
        raise InputError(f"{recording.name} has no worn camera; give the topics of its images and its pose.")
    board.check_direction()
    poses, covariances = np.full((count, 4, 4), np.nan), np.full((count, 6, 6), np.nan)
    together = Together(recording)
    for i in range(count):
        frame = together.frame(i)
        if not frame.views:
            continue
        with contextlib.suppress(DataError):  # one of them does not see it
            pair = (frame.image, recording.camera, frame.views[0].image, worn_camera)
            poses[i], covariances[i] = pose_between(*pair, [board])
    return poses, covariances

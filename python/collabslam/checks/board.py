"""Poses of the worn camera from a board that both cameras see, for `worn_pose.calibrate_person`."""

from __future__ import annotations

import contextlib

import numpy as np

from collabslam._core import Camera
from collabslam.errors import DataError, InputError
from collabslam.frontend.target import checkerboard_points, pose_from_points
from collabslam.geometry import adjoint, pose_inverse
from collabslam.types import Array, Board, Image, Recording

_SIGMA = 0.15
"""Least standard deviation of a corner, pixels: a board has so many that their scatter tells it, but for what
neighbours have in common."""


def pose_between(
    image: Image, camera: Camera, worn_image: Image, worn_camera: Camera, board: Board
) -> tuple[Array, Array]:
    """``T_CF`` from a board in both pictures.

    Parameters
    ----------
    image, worn_image : (H, W) uint8
        Of Cs and of Cf, taken at the same time.
    camera, worn_camera : Camera
    board : Board

    Returns
    -------
    t_cf : (4, 4) float64
        Maps points of F into C, metres.
    covariance : (6, 6) float64
        Over (translation, rotation), tangent on the right; m^2 and rad^2.

    Raises
    ------
    DataError
        If a camera does not see the board whole.
    """
    (t_bc, of_cs), (t_bf, of_cf) = (
        pose_from_points(*checkerboard_points(picture, board.columns, board.rows, board.square), lens, _SIGMA)
        for picture, lens in ((image, camera), (worn_image, worn_camera))
    )
    t_cf = pose_inverse(t_bc) @ t_bf
    carry = adjoint(pose_inverse(t_cf))
    return t_cf, of_cf + carry @ of_cs @ carry.T


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
        Poses and covariances of all frames; NaN where both cameras do not see the board whole.

    Raises
    ------
    InputError
        If there is no worn camera.
    """
    count, worn_camera = len(recording), recording.worn_camera
    if worn_camera is None:
        raise InputError(f"{recording.name} has no worn camera; give the topics of its images and its pose.")
    poses, covariances = np.full((count, 4, 4), np.nan), np.full((count, 6, 6), np.nan)
    for i in range(count):
        frame = recording.frame(i)
        if frame.worn is None:
            continue
        with contextlib.suppress(DataError):  # one of them does not see it
            pair = (frame.image, recording.camera, frame.worn.image, worn_camera)
            poses[i], covariances[i] = pose_between(*pair, board)
    return poses, covariances

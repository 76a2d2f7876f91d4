"""A recording whose worn camera has other poses than the measured ones it was made with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from collabslam.checks.board import board_poses
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.types import Array, Frame, Recording, WornView
from collabslam.worn_pose import Person, PersonFit, calibrate_person
from collabslam_lab.worlds import WorldRecording
from collabslam_lab.worlds.catalogue import BOARD, with_board
from collabslam_lab.worlds.sensors import config_of, estimated_poses, readings_of

_WALKS = 3
"""Walks towards the board: one lasts some five seconds."""


class WithPoses(WrappedRecording):
    """A recording with given poses of Cf; frames without one have no worn view.

    Parameters
    ----------
    base : Recording
    poses : mapping of frame index to (T_CF (4, 4), covariance (6, 6), bias (6, 6) or None)
        As in `WornView`.
    """

    def __init__(self, base: Recording, poses: Mapping[int, tuple[Array, Array, Array | None]]) -> None:
        super().__init__(base)
        self._poses = poses

    def frame(self, i: int) -> Frame:
        """Frame ``i``, its worn view with the given pose."""
        frame = self._base.frame(i)
        if i not in self._poses:
            return replace(frame, views=())
        return replace(frame, views=tuple(WornView(v.image, *self._poses[i]) for v in frame.views))


def sensed(
    world: WorldRecording, held: Recording, seed: int, *, calibrated: bool
) -> tuple[Recording, dict[str, Any]]:
    """The recording with poses from laser and AHRS, each with the part of its covariance that lasts.

    Parameters
    ----------
    world, held : Recording
        As it is made, and the same with its pictures kept.
    seed : int
        Of the sensors' noise.
    calibrated : bool
        Whether the person first walked towards a board, or is only known as `Person` says.

    Returns
    -------
    recording, settings
        The setting is ``filter.worn.bias_time``: how long it lasts.
    """
    person = calibrated_person(world, seed).person if calibrated else None
    estimates = estimated_poses(world, readings_of(world, seed), person)
    poses = {
        i: (e.t_cf, e.covariance, e.bias)
        for i, e in enumerate(estimates)
        if e.t_cf is not None and e.covariance is not None
    }
    return WithPoses(held, poses), {"filter.worn.bias_time": config_of(world).ahrs.drift_time}


def calibrated_person(world: WorldRecording, seed: int) -> PersonFit:
    """How the person of a recording is built and steps, from other walks with them, towards a board."""
    person = Person()
    for k in range(_WALKS):
        noise = _WALKS * seed + k
        walk = WorldRecording(with_board(world.recipe), noise, keep=True)
        estimates = estimated_poses(walk, readings_of(walk, noise), person)
        fit = calibrate_person(person, estimates, *board_poses(walk, BOARD))
        person = fit.person
    return fit

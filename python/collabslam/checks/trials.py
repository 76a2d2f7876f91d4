"""What may be wrong with T_CF, the clocks and both cameras, as trials that a view can be put to."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from collabslam.checks.mistakes import (
    FOCALS,
    MIRRORS,
    SIZES,
    WORN_POSE_MISTAKES,
    MirroredCamera,
    PoseMistake,
    rig_mistakes,
    undone,
)
from collabslam.checks.robot import RobotReport
from collabslam.checks.views import View
from collabslam.geometry import pose_inverse
from collabslam.types import Array

_FOCAL = 0.049
"""Errors of the focal length up to here are too like those of T_CF to be told from them."""


class Trial(NamedTuple):
    """Cameras, distances in frames of Cs's image and of T_CF from the view, and what undoes the poses."""

    fault: str
    remedy: str
    models: tuple[MirroredCamera, MirroredCamera]
    image: int = 0
    pose: int = 0
    mistake: PoseMistake | None = None

    def t_cf(self, view: View) -> Array:
        """Where Cf was in the view, seen from Cs in its frame, if the mistake was made."""
        return view.moved @ undone(self.mistake, view.poses[self.pose])


def worn_trials(
    models: tuple[MirroredCamera, MirroredCamera],
    views: list[View],
    between: float,
    robot: RobotReport,
    t_bs: Array | None = None,
) -> Iterator[Trial]:
    """What is given with each usual mistake undone; ``t_bs`` is that of Cs, where T_CF follows from it."""
    for mistake in (*WORN_POSE_MISTAKES, *rig_mistakes(t_bs)):
        yield Trial(mistake.fault, mistake.remedy, models, mistake=mistake)
    yield from _swaps(models)
    yield from clock_trials(models, views, between, alone=not robot.by_gap)
    for which, name in enumerate(("Cs", "Cf")):
        if which == 0 and robot.by_gap:
            continue  # the true poses have spoken
        for mirror in MIRRORS:
            changed = _changed(models, which, mirror.undo(models[which]))
            yield Trial(mirror.fault.format(camera=name), mirror.remedy, changed)
        for focal in FOCALS[np.abs(FOCALS - 1.0) > _FOCAL]:
            text = f"the focal length of {name} does not fit, about {focal:.2f} times the calibrated one does"
            if not robot.by_gap:
                text += " (or the other camera's the other way round)"
            changed = _changed(models, which, models[which].with_focal(float(focal)))
            yield Trial(text, "calibrate this camera at this resolution", changed)
        for size in SIZES:
            text = f"the images of {name} were scaled after the calibration, by {size:.2f}"
            changed = _changed(models, which, models[which].scaled(float(size)))
            yield Trial(text, "scale focal lengths and centre in the calibration alike", changed)
    if not robot.by_gap:
        for mirror in MIRRORS:
            both = (mirror.undo(models[0]), mirror.undo(models[1]))
            yield Trial(mirror.fault.format(camera="both cameras"), mirror.remedy, both)


def _swaps(models: tuple[MirroredCamera, MirroredCamera]) -> Iterator[Trial]:
    sizes = [(e.camera.width, e.camera.height) for e in models]
    if sizes[0] != sizes[1] or models[0] == models[1]:
        return
    exchanged, inverse = (models[1], models[0]), PoseMistake("", "", pose_inverse)
    yield Trial(
        "the images of Cs and Cf are swapped", "exchange their folders or topics", exchanged, 0, 0, inverse
    )
    yield Trial("the calibrations of Cs and Cf are swapped", "exchange them", exchanged)


def clock_trials(
    models: tuple[MirroredCamera, MirroredCamera], views: list[View], between: float, *, alone: bool
) -> Iterator[Trial]:
    """The clocks of T_CF and of the images, off by so many frames.

    Whether it is Cf's images or Cs's makes a difference by T_CF alone, which hardly changes in that time.
    On a way straight ahead an image of one frame later is larger, as one of another focal length is; without
    true poses (``alone``) nothing tells the two from each other.
    """
    for m in sorted({m for v in views for m in v.matches} - {0}):
        early, late = ("early", "late") if m > 0 else ("late", "early")
        apart = f"{abs(m) * between:.2f} s"
        images = f"the images of Cf are stamped {apart} too {early}, or those of Cs too {late}"
        yield Trial(f"the poses T_CF are stamped {apart} too {late}", "correct the clocks", models, 0, m)
        remedy = "correct the clocks"
        if alone and abs(m) == 1:
            remedy += (
                "; without true poses a focal length that is a few per cent off looks the same: calibrate Cs"
            )
        yield Trial(images, remedy, models, m, m)
        yield Trial(images, remedy, models, m, 0)


def _changed(
    models: tuple[MirroredCamera, MirroredCamera], which: int, model: MirroredCamera
) -> tuple[MirroredCamera, MirroredCamera]:
    return (model, models[1]) if which == 0 else (models[0], model)

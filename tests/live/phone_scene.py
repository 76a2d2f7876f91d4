"""A phone on a stand that films what a robot drives towards, and a tag that both see."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from helpers.posted import Posted, paint

from collabslam import Camera, Tag
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.geometry import pose, rotation_exp
from collabslam.simulation import corridor_recording
from collabslam.simulation.held import HeldRecording
from collabslam.simulation.recording import SimulatedRecording
from collabslam.simulation.rendered import PIXEL_NOISE
from collabslam.simulation.trajectory import CorridorWalk
from collabslam.types import Array, Frame, Image

TAG = Tag("36h11", 3, 0.3)
PHONE = Camera("pinhole", 640, 480, (545.0, 545.0, 319.5, 239.5))
AHEAD = pose(rotation_exp([0.1, 0.5, 0.05]), [0.15, 0.0, 2.8])
"""The tag in the robot's first frame."""
WAY, STEPS, RATE = 1.0, 40, 5.0
"""Metres there and as many back, frames in which it goes there, frames per second."""
_SPEED = 1.5  # of the walk from which the poses are taken, metres per second


class ThereAndBack(WrappedRecording):
    """The robot's camera alone; it drives towards the tag and back again for as long as anybody looks."""

    def __init__(self) -> None:
        seconds = 0.5 * WAY * (1.0 - np.cos(np.linspace(0.0, np.pi, STEPS + 1))) / _SPEED
        first = corridor_recording()
        there = SimulatedRecording(first.renderer, CorridorWalk(_SPEED), seconds, "there", 0)
        posted = Posted(there, [(TAG, tag_pose(there))], alone=True)
        super().__init__(HeldRecording(posted))
        self.times = np.arange(3000) / RATE
        self._order = [*range(STEPS + 1), *range(STEPS - 1, 0, -1)]
        self.truth = np.stack([there.truth[self._at(i)] for i in range(len(self))])

    def __len__(self) -> int:
        return len(self.times)

    def frame(self, i: int) -> Frame:
        return replace(self._base.frame(self._at(i)), index=i, t=float(self.times[i]))

    def _at(self, i: int) -> int:
        return self._order[i % len(self._order)]


def tag_pose(there: SimulatedRecording) -> Array:
    """T_WT (4, 4)."""
    return np.asarray(there.truth[0] @ AHEAD)


def phone_video(path: Path) -> Path:
    """What the phone films: one picture with other noise again and again, as JPEGs one after another."""
    first = corridor_recording()
    there = SimulatedRecording(first.renderer, CorridorWalk(_SPEED), np.array([0.0, 1.0]), "there", 0)
    stand = there.person(0.0)
    clean = paint(there.renderer.render(stand, PHONE), PHONE, stand, TAG, tag_pose(there))
    generator = np.random.default_rng(0)
    with path.open("wb") as file:
        for _ in range(12):
            noisy = clean + PIXEL_NOISE * generator.standard_normal(clean.shape)
            image = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
            file.write(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes())
    return path


def tracked_shots() -> list[tuple[Image, Array]]:
    """Pictures of a phone that is carried, and T_WF of each (4, 4); the tag is in the first one alone."""
    first = corridor_recording()
    there = SimulatedRecording(first.renderer, CorridorWalk(_SPEED), np.array([0.0, 1.0]), "there", 0)
    stand = there.person(0.0)
    steps = [(0.0, 0.0), (0.06, 0.02), (-0.05, -0.03), (0.02, 0.04), (0.1, 0.0)]
    generator = np.random.default_rng(0)
    shots = []
    for k, (aside, turn) in enumerate(steps):
        at = stand @ pose(rotation_exp([0.0, turn, 0.0]), [aside, 0.0, 0.0])
        image = there.renderer.render(at, PHONE)
        if k == 0:
            image = paint(image, PHONE, at, TAG, tag_pose(there))
        noisy = image + PIXEL_NOISE * generator.standard_normal(image.shape)
        shots.append((np.clip(np.rint(noisy), 0, 255).astype(np.uint8), np.asarray(at)))
    return shots

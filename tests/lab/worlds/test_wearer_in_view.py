"""The wearer of Cf walks ahead in view of Cs (world f, as hard as life): they are no landmark."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from collabslam import Settings, Slam
from collabslam.frontend.wearer_mask import Outline
from collabslam.results import StepResult
from collabslam.types import Frame, Status
from collabslam_lab.worlds import world_recording

FIRST, COUNT = 450, 25
"""Frames, in which they are 2 m ahead."""


@pytest.fixture(scope="module")
def world() -> Any:
    return world_recording("f-life", 0)


@pytest.fixture(scope="module")
def frames(world: Any) -> list[Frame]:
    return [world.frame(i) for i in range(FIRST, FIRST + COUNT)]


@pytest.fixture(scope="module")
def ran(world: Any, frames: list[Frame]) -> Any:
    @cache
    def steps(radius: float) -> list[StepResult]:
        settings = Settings.default().replace({"frontend.worn.body_radius": radius})
        slam = Slam(world.camera, world.worn_camera, settings=settings)
        return [slam.step(f.t, f.image, f.views) for f in frames]

    return steps


DEFAULT = Settings.default().frontend.worn.body_radius


def _on_them(world: Any, frames: list[Frame], steps: list[StepResult]) -> int:
    """Features found within 0.2 m of the middle of the body."""
    count = 0
    for frame, step in zip(frames, steps, strict=True):
        found = step.features.found[np.isfinite(step.features.found).all(axis=1)]
        for view in frame.views:
            body = Outline(view.t_cf[:3, 3], view.t_cf[:3, 1], 0.2, 1.8)
            count += int(body.hides(world.camera, found).sum())
    return count


def test_their_clothes_are_no_landmarks(world: Any, frames: list[Frame], ran: Any) -> None:
    assert _on_them(world, frames, ran(0.0)) >= 5
    assert _on_them(world, frames, ran(DEFAULT)) == 0
    strayed = [sum(s.diagnostics["candidates_off_arc"] for s in ran(radius)) for radius in (0.0, DEFAULT)]
    assert strayed[0] >= 5
    assert strayed[1] == 0


def test_what_is_left_out_is_told(ran: Any) -> None:
    for step in ran(DEFAULT):
        told = step.diagnostics
        assert told["wearers"] == 1
        assert told["wearers_unseen"] == 0
        assert 10.0 < told["left_out_pct"] < 50.0
        assert told["left_out_pct"] == pytest.approx(100.0 * step.features.left_out.mean())
    assert all(s.diagnostics["left_out_pct"] == 0.0 for s in ran(0.0))


def test_the_frames_are_to_be_trusted_without_them(ran: Any) -> None:
    assert {s.status for s in ran(DEFAULT)} == {Status.OK}
    assert ran(0.0)[-1].status is Status.DEGRADED


def test_the_way_is_as_it_was(world: Any, ran: Any) -> None:
    start = np.linalg.inv(world.truth[FIRST])
    truth = start @ world.truth[FIRST + COUNT - 1]
    error = np.linalg.inv(truth) @ ran(DEFAULT)[-1].pose
    assert np.linalg.norm(error[:3, 3]) < 0.03 * np.linalg.norm(truth[:3, 3])

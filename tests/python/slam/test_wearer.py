"""Whoever wears Cf is left out of the pictures of Cs; a view that runs out of features gets vague ones."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import Camera
from collabslam.frontend.wearer_mask import Outline
from collabslam.geometry import rotation_exp
from collabslam.results import StepResult
from collabslam.settings.table import Settings
from collabslam.slam.engine import Slam
from collabslam.types import Array, Mask
from collabslam_lab.switches import with_switches

RADIUS, HEIGHT = 0.3, 2.0


def _upright_at(right: float, down: float, ahead: float, yaw: float = 0.0) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = rotation_exp([0.0, yaw, 0.0])
    pose[:3, 3] = right, down, ahead
    return pose


def covered(camera: Camera, uv: Array, t_cf: Array, radius: float) -> Mask:
    return Outline(t_cf[:3, 3], t_cf[:3, 1], radius, HEIGHT).hides(camera, uv)


@pytest.fixture(scope="module")
def camera() -> Camera:
    return Camera("pinhole", 720, 480, (740.0, 740.0, 360.0, 240.0))


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_the_body_is_a_capsule_below_the_worn_camera(camera: Camera, yaw: float) -> None:
    t_cf = _upright_at(0.4, -0.75, 2.5, yaw)
    inside = [(0.4, -0.7, 2.5), (0.4, 0.9, 2.5), (0.65, 0.0, 2.5), (0.15, 0.0, 2.5), (1.6, 0.0, 10.0)]
    outside = [(0.75, 0.0, 2.5), (0.05, 0.0, 2.5), (-0.4, 0.0, 2.5), (0.3, 0.0, 12.0)]
    place = np.array([*inside, *outside])
    uv = place[:, :2] / place[:, 2:] * 740.0 + [360.0, 240.0]
    expected = [True] * len(inside) + [False] * len(outside)
    np.testing.assert_array_equal(covered(camera, uv, t_cf, RADIUS), expected)


def test_nobody_behind_the_robot_is_in_its_view(camera: Camera) -> None:
    grid = np.stack(np.meshgrid(np.arange(0.0, 720.0, 40.0), np.arange(0.0, 480.0, 40.0)), axis=-1)
    uv = grid.reshape(-1, 2)
    assert not covered(camera, uv, _upright_at(0.2, -0.75, -1.5), RADIUS).any()
    assert not covered(camera, uv, _upright_at(1.5, -0.75, 0.4), RADIUS).any()
    assert covered(camera, uv, _upright_at(0.0, -0.75, 1.0), RADIUS).any()
    assert covered(camera, np.empty((0, 2)), np.eye(4), RADIUS).shape == (0,)


@pytest.fixture(scope="module")
def steps(clip: Clip) -> Any:
    """Runs of `mono` in which somebody is said to walk ahead, by radius; the truth has nobody there."""

    @cache
    def played(radius: float) -> list[StepResult]:
        settings = Settings.default().replace({"frontend.worn.body_radius": radius})
        slam = Slam(clip.recording.camera, clip.recording.worn_camera, settings=settings, mode="mono")
        out = []
        for k, frame in enumerate(clip.frames):
            views = frame.views
            if k:
                views = tuple(
                    dataclasses.replace(v, t_cf=_upright_at(0.1, -0.6, 2.0), body=True) for v in views
                )
            out.append(slam.step(frame.t, frame.image, views))
        return out

    return played


def _hidden(clip: Clip, uv: Array) -> int:
    known = uv[np.isfinite(uv).all(axis=1)]
    return int(covered(clip.recording.camera, known, _upright_at(0.1, -0.6, 2.0), RADIUS).sum())


def test_nothing_is_searched_on_the_wearer(clip: Clip, steps: Any) -> None:
    worn = [k for k, frame in enumerate(clip.frames) if k and frame.views]
    assert sum(_hidden(clip, steps(0.0)[k].features.found) for k in worn) > 20
    assert sum(_hidden(clip, steps(RADIUS)[k].features.found) for k in worn) == 0
    assert all(s.status.value == "OK" for s in steps(RADIUS))


def _starved(clip: Clip, below: float) -> list[StepResult]:
    """More features asked for than a start gives, no Cf after it, and so much parallax that none is born."""
    changes = {"filter.birth.vague_below": below, "filter.birth.min_parallax": 60.0, "filter.map.in_view": 80}
    settings = with_switches(Settings.default(), changes)
    slam = Slam(clip.recording.camera, clip.recording.worn_camera, settings=settings, mode="collab")
    return [slam.step(f.t, f.image, () if slam.filter.started else f.views) for f in clip.frames]


def test_candidates_are_born_vague_where_the_view_runs_out_of_features(clip: Clip) -> None:
    below = 0.8
    for step in (starved := _starved(clip, below)):
        d = step.diagnostics
        assert d["births_delayed"] == 0
        assert d["births_undelayed"] <= max(0, 80 * below - d["accepted"] + d["births_instant"])
    assert sum(s.diagnostics["births_undelayed"] for s in starved[1:]) > 5
    assert starved[-1].diagnostics["map_size"] > starved[0].diagnostics["map_size"]
    assert all(s.diagnostics["births_undelayed"] == 0 for s in _starved(clip, 0.0))


@pytest.mark.parametrize("start", ["scale-free", "worn"])
def test_one_camera_alone_takes_vague_births_in_an_arbitrary_unit_and_to_stay(clip: Clip, start: str) -> None:
    settings = Settings.default().replace({"filter.lost.min_matches": 20, "filter.birth.min_parallax": 60.0})
    cameras = clip.recording.camera, clip.recording.worn_camera
    slam = Slam(*cameras, settings=settings, mode="mono", start=start)
    steps = [slam.step(f.t, f.image, f.views if start == "worn" else ()) for f in clip.frames]
    vague = [s.diagnostics["births_undelayed"] for s in steps if s.started]
    if start == "worn":
        assert vague, "it has started"
        assert sum(vague) == 0
        return
    assert sum(vague[1:]) > 0
    for s in steps[1:]:
        room = max(0, min(2 * 20, 24) - s.diagnostics["accepted"])
        assert s.diagnostics["births_undelayed"] <= room or not s.started

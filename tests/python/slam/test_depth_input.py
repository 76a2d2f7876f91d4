"""Depth of another sensor: it starts the map, measures it, and bad numbers are refused."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import InputError, SettingsError, Slam


def _grid(clip: Clip, i: int) -> tuple[np.ndarray, np.ndarray]:
    camera = clip.recording.camera
    depth = clip.recording.renderer.depth(clip.recording.truth[i], camera)
    v, u = np.mgrid[40 : camera.height - 40 : 8, 40 : camera.width - 40 : 8]
    return np.stack([u.ravel(), v.ravel()], axis=1), depth[v.ravel(), u.ravel()]


@pytest.mark.slow
def test_depth_starts_the_map_and_measures_it(clip: Clip) -> None:
    slam = Slam(clip.recording.camera, mode="mono", start="depth")
    first = slam.step(clip.frames[0].t, clip.frames[0].image)
    assert not first.started
    for i in (1, 2):
        uv, depth = _grid(clip, i)
        slam.add_depth(uv, depth, 0.01 * depth)
        result = slam.step(clip.frames[i].t, clip.frames[i].image)
        assert result.started
    assert result.diagnostics["map_size"] > 30
    assert result.diagnostics["births_depth"] < 20  # the second time they are measured instead
    nearer = np.linalg.inv(clip.recording.truth[1]) @ clip.recording.truth[2]
    np.testing.assert_allclose(result.pose[:3, 3], nearer[:3, 3], atol=0.03)
    after = slam.step(clip.frames[3].t, clip.frames[3].image)  # none given: none used
    assert after.diagnostics["births_depth"] == 0


@pytest.mark.parametrize(
    ("uv", "depth", "sigma"),
    [
        (np.zeros((2, 3)), 1.0, 0.1),
        (np.zeros((2, 2)), [1.0, 2.0, 3.0], 0.1),
        (np.zeros((2, 2)), [1.0, np.nan], 0.1),
        (np.zeros((2, 2)), [1.0, -1.0], 0.1),
        (np.zeros((2, 2)), 1.0, 0.0),
        ("pixels", 1.0, 0.1),
    ],
)
def test_bad_depths_are_refused(clip: Clip, uv: object, depth: object, sigma: object) -> None:
    slam = Slam(clip.recording.camera, mode="mono", start="depth")
    with pytest.raises(InputError, match="uv"):
        slam.add_depth(uv, depth, sigma)
    assert slam.step(0.0, clip.frames[0].image).diagnostics["births_depth"] == 0


def test_there_is_no_other_start(clip: Clip) -> None:
    with pytest.raises(SettingsError, match="worn, target, depth, odometry, scale-free, map"):
        Slam(clip.recording.camera, start="guess")

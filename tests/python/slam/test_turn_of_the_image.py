"""A frame whose features would turn the camera otherwise than its image as a whole turned (METHOD 27)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import Slam
from collabslam._core import SearchResult, pose_inverse, rotation_log
from collabslam.slam import frame_loop
from collabslam.slam.search import FrameSearch
from collabslam.types import Array

ROLLED = 3.0
"""Degrees by which all that is found turns about the image's centre, as on somebody who fills the view."""


def _turned(clip: Clip, monkeypatch: pytest.MonkeyPatch, share: float, *, rolled: bool) -> Array:
    """The turn of the last of some frames, as the filter has it, rad."""
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    for frame in clip.frames[:7]:
        before = slam.step(frame.t, frame.image, frame.views).pose
    search = FrameSearch.search
    c, s = np.cos(np.radians(ROLLED)), np.sin(np.radians(ROLLED))
    centre = np.array([clip.recording.camera.width, clip.recording.camera.height]) / 2.0

    def rolling(self: FrameSearch, *given: Any, **named: Any) -> Any:
        expected, found, slipped = search(self, *given, **named)
        was = found.result
        uv = (was.uv - centre) @ np.array([[c, s], [-s, c]]) + centre
        return expected, replace(found, result=SearchResult(uv, was.score, was.second, was.code)), slipped

    with monkeypatch.context() as patch:
        patch.setattr(frame_loop, "_FEW", share)
        if rolled:
            patch.setattr(FrameSearch, "search", rolling)
        frame = clip.frames[7]
        result = slam.step(frame.t, frame.image)
    assert before is not None
    assert result.pose is not None
    return rotation_log(np.ascontiguousarray((pose_inverse(before) @ result.pose)[:3, :3]))


def test_what_rolls_against_the_image_does_not_turn_the_camera(
    clip: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    true = _turned(clip, monkeypatch, 0.0, rolled=False)

    def off(share: float) -> float:
        return float(np.degrees(np.linalg.norm(_turned(clip, monkeypatch, share, rolled=True) - true)))

    assert off(0.0) > 0.7 * ROLLED  # nothing else objects
    assert off(10.0) < 0.3 * ROLLED


def test_an_image_that_turns_as_the_map_has_it_changes_nothing(
    clip: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = [_turned(clip, monkeypatch, share, rolled=False) for share in (0.0, 10.0)]
    np.testing.assert_array_equal(*asked)

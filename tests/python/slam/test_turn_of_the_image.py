"""A frame whose features would turn the camera otherwise than its image as a whole turned (METHOD 27)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import Slam
from collabslam._core import Camera, SearchResult, pose_inverse, rotation_exp, rotation_log
from collabslam.slam import frame_loop
from collabslam.slam.search import FrameSearch
from collabslam.types import Array, Image

ROLLED = 3.0
"""Degrees by which all that is found turns about the image's centre, as on somebody who fills the view."""
YAWED = 9.0
"""Degrees by which the camera turns in one frame of 0.1 s, out of a straight way."""


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


@pytest.mark.parametrize("again", [True, False])
def test_a_frame_that_turned_otherwise_than_expected_is_searched_from_where_it_turned_to(
    clip: Clip, monkeypatch: pytest.MonkeyPatch, again: bool
) -> None:
    camera = clip.recording.camera
    slam = Slam(camera, clip.recording.worn_camera)
    for frame in clip.frames[:7]:
        before = slam.step(frame.t, frame.image, frame.views).pose
    if not again:
        monkeypatch.setattr(frame_loop.FrameLoop, "_measure_again", lambda *_: None)
    frame = clip.frames[7]
    result = slam.step(frame.t, _turned_image(camera, frame.image, np.radians([0.0, YAWED, 0.0])))
    assert before is not None
    assert result.pose is not None
    turn = rotation_log(np.ascontiguousarray((pose_inverse(before) @ result.pose)[:3, :3]))
    # Without, it is found again as one that had lost its way.
    assert result.diagnostics["relocalised"] == (0 if again else 1)
    assert result.diagnostics["accepted"] >= 20
    assert np.degrees(turn[1]) == pytest.approx(YAWED, abs=0.5)


def _turned_image(camera: Camera, image: Image, turn: Array) -> Image:
    """What the camera would show where it is, turned by a rotation vector along its axes."""
    u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    rays = camera.unproject(np.column_stack([u.ravel(), v.ravel()])) @ rotation_exp(turn).T
    x, y = (
        camera.project(rays).uv.reshape(camera.height, camera.width, 2).astype(np.float32).transpose(2, 0, 1)
    )
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR), np.uint8)

"""Tags of a map that was made inactive: the camera is back in it as soon as it sees one of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from helpers.clip import GLOBAL_SHUTTER, Clip
from helpers.posted import Posted, paint

from collabslam import Frame, Settings, Slam, Tag
from collabslam.geometry import pose, pose_inverse, rotation_exp, se3_log
from collabslam.results import StepResult
from collabslam.slam.recovery.relocalise import Relocaliser
from collabslam.types import Array, Image, Status, WornView

pytestmark = pytest.mark.slow

TAG = Tag("36h11", 3, 0.24)
PLACE = pose(rotation_exp([0.1, 0.6, 0.05]), [0.15, 0.0, 2.3])
"""Beside the corridor's way, seen from where Cs starts."""
SEEN = 8


class Walk:
    """An engine in the corridor, started from a tag; frames come every 0.1 s, wherever they were taken."""

    def __init__(self, clip: Clip) -> None:
        self.recording = clip.recording
        self.start = self.recording.truth[0]
        self.tagged = Posted(self.recording, [(TAG, self.start @ PLACE)])
        cameras = self.tagged.camera, self.tagged.worn_camera
        settings = Settings.default().replace(GLOBAL_SHUTTER)
        self.slam, self.t = Slam(*cameras, settings=settings, start="target", target=TAG), 0.0
        for i in range(SEEN):
            frame = self.tagged.frame(i)
            assert self.step(frame.image, frame.views).status is not Status.LOST
        for _ in range(4):
            self.step(np.zeros_like(self.tagged.image(0)))

    def step(self, image: Image, views: Sequence[WornView] = ()) -> StepResult:
        self.t += 0.1
        return self.slam.step(self.t, image, views)

    def restarts(self, frame: Frame) -> None:
        """From a view of Cf that shows nothing of the tag."""
        assert self.step(frame.image, frame.views).diagnostics["restarted"] == 1

    def distance(self, result: StepResult, i: int) -> float:
        """Metres from where frame ``i`` was taken, in the first map."""
        error = se3_log(pose_inverse(result.pose) @ pose_inverse(self.start) @ self.recording.truth[i])
        return float(np.linalg.norm(error[:3]))


def bare(walk: Walk, i: int, place: Array = PLACE) -> Image:
    """Frame ``i`` of a wall that was papered meanwhile: nothing but the tag is as it was."""
    camera = walk.tagged.camera
    noise = np.random.default_rng(i).normal(120.0, 2.0, (camera.height, camera.width)).astype(np.uint8)
    return paint(noise, camera, walk.recording.truth[i], TAG, walk.start @ place)


def test_lost_in_another_map_the_tag_leads_back(clip: Clip, tmp_path: Path) -> None:
    walk = Walk(clip)
    for i in range(80, 84):
        frame = walk.recording.frame(i)
        views = frame.views or walk.recording.frame(82).views
        if walk.step(frame.image, views).diagnostics["restarted"]:
            break
    unsure = np.trace(walk.slam.filter.pose_covariance[:3, :3])
    walk.slam.save(tmp_path / "engine")
    results = [walk.step(bare(walk, i)) for i in range(SEEN, SEEN + 3)]
    assert results[0].diagnostics["relocalised"] == 1
    assert all(result.valid for result in results)
    assert walk.distance(results[0], SEEN) < 0.2
    assert np.trace(results[0].covariance[:3, :3]) < 0.1 * unsure
    again = Slam.load(tmp_path / "engine")  # a file of the engine holds the tags of the inactive maps
    assert again.step(walk.t - 0.2, bare(walk, SEEN)).pose.tobytes() == results[0].pose.tobytes()


def test_well_in_another_map_the_tag_leads_back_unless_it_was_moved(
    clip: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Relocaliser, "attempt", lambda *_: None)
    monkeypatch.setattr(Relocaliser, "look_back", lambda *_: None)
    walk = Walk(clip)
    first = next(f for f in map(walk.recording.frame, range(SEEN, 14)) if f.views)
    walk.restarts(first)
    camera, truth = walk.tagged.camera, walk.recording.truth
    moved = pose(np.eye(3), [-0.3, 0.0, 2.5]) @ PLACE
    for i in range(first.index + 1, first.index + 4):  # it hangs elsewhere: taken for new
        image = paint(walk.recording.image(i), camera, truth[i], TAG, walk.start @ moved)
        result = walk.step(image)
        assert result.diagnostics["relocalised"] == 0
        assert (result.status, result.diagnostics["degraded_by"]) == (Status.DEGRADED, "attitude")
    i = first.index + 4
    result = walk.step(walk.tagged.image(i))
    assert result.valid
    assert result.diagnostics["relocalised"] == 1
    assert walk.distance(result, i) < 0.3
    for later in range(i + 1, i + 4):
        result = walk.step(walk.tagged.image(later))
        assert result.valid
    assert walk.distance(result, later) < 0.1

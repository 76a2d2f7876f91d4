"""A camera that is lost says so, keeps its map, and finds itself in it again: the demo, frames cut out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from collabslam._core import FilterSettings
from collabslam.frontend.detect import detect_corners
from collabslam.frontend.patch import capture
from collabslam.frontend.place_recognition import (
    describe_corners,
    describe_views,
    match_descriptors,
    pose_by_ransac,
    pose_of_agreeing,
)
from collabslam.geometry import pose_inverse, se3_exp, se3_log
from collabslam.results import StepResult
from collabslam.settings.table import Settings
from collabslam.simulation import SimulatedRecording, corridor_recording
from collabslam.slam.engine import Slam
from collabslam.slam.recovery.relocalise import Relocaliser
from collabslam.slam.status import StatusMonitor
from collabslam.targets.pose import pose_from_points
from collabslam.types import Array, Image, Status, WornView

SEEN = 20
"""Frames before the camera is lost."""
SECOND = 10
"""Frames of a second."""


@pytest.fixture(scope="module")
def recording() -> SimulatedRecording:
    return corridor_recording()


@pytest.fixture(scope="module")
def images(recording: SimulatedRecording) -> list[Image]:
    return [recording.image(i) for i in range(SEEN + 2 * SECOND + 4)]


class Walk:
    """The first frames of the demo through the filter; what follows is up to the test."""

    def __init__(self, recording: SimulatedRecording, *, mode: str = "mono", seen: int = SEEN) -> None:
        self.recording = recording
        self.slam = Slam(recording.camera, recording.worn_camera, mode=mode)
        for i in range(seen):
            frame = recording.frame(i)
            self.last = self.slam.step(frame.t, frame.image, frame.views)
        assert self.last.status is Status.OK
        self.t = self.last.t

    def step(self, image: Image, views: Sequence[WornView] = ()) -> StepResult:
        self.t += 0.1
        self.last = self.slam.step(self.t, image, views)
        return self.last

    def ids(self) -> list[int]:
        return list(self.slam.landmarks().ids)

    def error(self, i: int) -> Array:
        """Error of the last pose in its tangent, the truth being that of frame ``i``."""
        truth = pose_inverse(self.recording.truth[0]) @ self.recording.truth[i]
        return se3_log(pose_inverse(self.last.pose) @ truth)

    def is_right(self, i: int) -> None:
        error = self.error(i)
        assert np.linalg.norm(error[:3]) < 0.3  # a fifth of the way from where it was lost
        assert np.degrees(np.linalg.norm(error[3:])) < 2.0
        assert error @ np.linalg.solve(self.last.covariance, error) < 22.5  # 99.9 % of six numbers


def _dark(shape: tuple[int, ...]) -> Iterator[Image]:
    while True:
        yield np.zeros(shape, np.uint8)


def _covered(image: Image) -> Iterator[Image]:
    """A hand before the lens: dark and without form, but for noise."""
    generator = np.random.default_rng(0)
    glow = 0.1 * cv2.GaussianBlur(image, (0, 0), 60.0).astype(np.float64)
    while True:
        yield np.clip(glow + generator.normal(0.0, 2.5, image.shape), 0, 255).astype(np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["black", "covered"])
def test_a_second_in_the_dark(recording: SimulatedRecording, images: list[Image], how: str) -> None:
    walk = Walk(recording)
    before, ids = walk.last, walk.ids()
    dark = _dark(images[0].shape) if how == "black" else _covered(images[SEEN])
    blind = [walk.step(next(dark)) for _ in range(SECOND)]
    assert [s.status for s in blind] == [Status.COASTING] * 2 + [Status.LOST] * (SECOND - 2)
    assert [s.valid for s in blind] == [True] * 2 + [False] * (SECOND - 2)
    assert all(s.diagnostics["accepted"] == s.diagnostics.get("deleted", 0) == 0 for s in blind)
    traces = [np.trace(s.covariance[:3, :3]) for s in (before, *blind)]
    assert (np.diff(traces) > 0).all()
    assert walk.ids() == ids
    assert walk.slam.filter.soundness() > -1e-10
    again = SEEN + SECOND
    for i in range(again, again + SECOND):
        if walk.step(images[i]).status is Status.OK:
            break
    assert walk.last.status is Status.OK
    assert walk.last.valid
    walk.is_right(i)
    for later in range(i + 1, i + 4):
        assert walk.step(images[later]).status is Status.OK
        walk.is_right(later)


def _jump(recording: SimulatedRecording, images: list[Image]) -> tuple[Walk, list[StepResult]]:
    """Ten frames cut out: from one frame to the next the camera is a metre and a half farther on."""
    walk = Walk(recording)
    steps = []
    for i in range(SEEN + SECOND, SEEN + 2 * SECOND):
        steps.append(walk.step(images[i]))
        if steps[-1].diagnostics["relocalised"]:
            break
    return walk, steps


def _is_a_jump(step: StepResult) -> bool:
    """It is there, and says that it cannot have got there."""
    return step.valid and step.status is Status.DEGRADED and step.diagnostics["degraded_by"] == "jump"


@pytest.mark.slow
def test_a_jump(recording: SimulatedRecording, images: list[Image]) -> None:
    walk, steps = _jump(recording, images)
    jump = np.linalg.norm((pose_inverse(recording.truth[SEEN]) @ recording.truth[SEEN + SECOND])[:3, 3])
    assert len(steps) == 1  # what fails is compared with the map at once
    assert steps[0].diagnostics["relocalised"] == 1
    assert steps[0].diagnostics["found"] > 0  # some wrong matches, and none is used
    assert all(steps[0].diagnostics[k] == 0 for k in ("births_delayed", "deleted"))
    last = steps[-1]
    assert _is_a_jump(last)
    assert last.diagnostics["accepted"] >= 8
    i = SEEN + SECOND + len(steps) - 1
    walk.is_right(i)
    sd = np.sqrt(np.trace(last.covariance[:3, :3]))
    assert 0.5 * jump < sd < jump  # it may be where prediction had it, and the map is elsewhere then
    assert walk.slam.filter.soundness() > -1e-10
    for later in range(i + 1, i + 4):
        assert _is_a_jump(walk.step(images[later]))
        walk.is_right(later)


@pytest.mark.slow
def test_a_jump_ends_alike_to_the_bit(recording: SimulatedRecording, images: list[Image]) -> None:
    (one, _), (two, _) = _jump(recording, images), _jump(recording, images)
    assert one.last.pose.tobytes() == two.last.pose.tobytes()
    assert one.last.covariance.tobytes() == two.last.covariance.tobytes()


def _elsewhere(recording: SimulatedRecording, mode: str) -> tuple[Walk, list[StepResult]]:
    """From its first frames to nine metres on: nothing of the map is in sight, and Cf sees what Cs sees."""
    walk = Walk(recording, mode=mode, seen=12)
    steps = []
    for i in range(80, 88):
        frame = recording.frame(i)
        steps.append(walk.step(frame.image, frame.views or recording.frame(82).views))
    return walk, steps


@pytest.mark.slow
def test_lost_it_starts_again_where_cf_sees_what_it_sees(recording: SimulatedRecording) -> None:
    walk, steps = _elsewhere(recording, "collab-tight")
    assert [s.status for s in steps] == [Status.COASTING] * 2 + [Status.LOST] + [Status.OK] * 5
    assert [s.diagnostics["restarted"] for s in steps] == [0, 0, 0, 1, 0, 0, 0, 0]
    before, start, last = steps[2], steps[3], steps[-1]
    assert np.allclose(start.pose, before.pose, atol=1.0)  # one frame of prediction apart
    assert np.trace(start.covariance) > np.trace(before.covariance)  # where it is in W, it does not know
    truth = recording.truth
    moved = se3_log(pose_inverse(start.pose) @ last.pose)
    really = se3_log(pose_inverse(truth[83]) @ truth[87])
    assert np.linalg.norm(moved - really) < 0.15 * np.linalg.norm(really[:3])  # in metres
    assert all(s.diagnostics["map_size"] >= 8 for s in steps[3:])
    assert walk.slam.filter.soundness() > -1e-10


@pytest.mark.slow
def test_without_cf_there_is_no_second_map(recording: SimulatedRecording) -> None:
    walk, steps = _elsewhere(recording, "mono")
    assert [s.status for s in steps] == [Status.COASTING] * 2 + [Status.LOST] * 6
    assert all(s.diagnostics["accepted"] == s.diagnostics["restarted"] == 0 for s in steps)
    assert not walk.last.valid


@pytest.mark.slow
def test_back_in_the_first_map(recording: SimulatedRecording, images: list[Image], tmp_path: Path) -> None:
    walk, steps = _elsewhere(recording, "collab-tight")
    unsure = np.trace(steps[-1].covariance)
    walk.slam.save(tmp_path / "engine")
    for i in range(11, 11 + 2 * SECOND):  # a jump to where it began
        before = walk.last.pose
        step = walk.step(images[i])
        if step.diagnostics["relocalised"]:
            break
    assert _is_a_jump(step)
    walk.is_right(i)
    jump = se3_log(pose_inverse(before) @ step.pose)
    assert 0.3 * (jump @ jump) < np.trace(step.covariance) < 0.1 * unsure + 0.7 * (jump @ jump)
    again = Slam.load(tmp_path / "engine")  # a checkpoint holds the map that was made inactive
    times = walk.t - 0.1 * (i - 11) + 0.1 * np.arange(i - 10)
    for k, t in zip(range(11, i + 1), times, strict=True):
        other = again.step(float(t), images[k])
    assert other.diagnostics["relocalised"] == 1
    for later in range(i + 1, i + 4):
        assert _is_a_jump(walk.step(images[later]))
        walk.is_right(later)


@pytest.mark.slow
def test_it_looks_back_while_it_is_ok(
    recording: SimulatedRecording, images: list[Image], monkeypatch: pytest.MonkeyPatch
) -> None:
    walk = Walk(recording, mode="collab", seen=8)
    dark = _dark(images[0].shape)
    for _ in range(4):
        walk.step(next(dark))
    with monkeypatch.context() as patch:  # it would find itself at once
        patch.setattr(Relocaliser, "attempt", lambda *_: None)
        frame = next(f for f in map(recording.frame, range(8, 14)) if f.views)
        assert walk.step(frame.image, frame.views).diagnostics["restarted"] == 1
    for i in range(frame.index + 1, frame.index + 1 + 2 * SECOND):
        step = walk.step(images[i])
        assert step.status is Status.OK
        if step.diagnostics["relocalised"]:
            break
    assert step.diagnostics["relocalised"] == 1
    walk.is_right(i)


@pytest.mark.slow
def test_elsewhere_it_stays_lost(recording: SimulatedRecording, images: list[Image]) -> None:
    walk = Walk(recording)
    ids = walk.ids()
    statuses = [walk.step(recording.image(i)).status for i in range(88, 96)]
    assert statuses == [Status.COASTING] * 2 + [Status.LOST] * 6
    turned = np.ascontiguousarray(images[SEEN][::-1, ::-1])
    assert walk.step(turned).status is Status.LOST
    assert walk.ids() == ids


class TestStatus:
    def monitor(self, lost: bool = False, **changes: Any) -> StatusMonitor:
        settings = FilterSettings({f"lost.{k}": v for k, v in changes.items()})
        return StatusMonitor(settings.lost, lost=lost)

    def test_three_frames_that_fail(self) -> None:
        m = self.monitor()
        assert m.update(0.0, 8, accepted=True) is Status.OK
        seen = [m.update(0.01 * k, 0, accepted=False) for k in range(1, 5)]
        assert seen == [Status.COASTING, Status.COASTING, Status.LOST, Status.LOST]

    def test_lost_until_a_full_set_is_found(self) -> None:
        m = self.monitor(lost=True)
        assert m.min_inliers(0) == 8
        assert m.min_inliers(100) == 15
        assert m.update(0.0, 7, accepted=True) is Status.LOST
        assert m.update(0.1, 8, accepted=True) is Status.OK
        assert not m.lost

    def test_what_says_nothing_ends_no_streak(self) -> None:
        m = self.monitor()
        assert m.update(0.0, 8, accepted=True) is Status.OK
        assert m.min_inliers(5) == 0
        assert m.update(0.1, 0, accepted=False) is Status.COASTING
        assert m.min_inliers(5) == 8  # it has failed: where little is expected, much is asked
        assert m.update(0.11, 0, accepted=True) is Status.COASTING  # the same image again
        assert m.update(0.2, 0, accepted=False) is Status.COASTING
        assert m.update(0.3, 0, accepted=False) is Status.LOST

    def test_too_few_for_a_second(self) -> None:
        m = self.monitor()
        assert m.update(0.0, 9, accepted=True) is Status.OK
        seen = [m.update(0.25 * k, 5, accepted=True) for k in range(1, 6)]
        assert seen == [Status.COASTING] * 4 + [Status.LOST]

    @pytest.mark.parametrize(
        ("searched", "expected"), [(0, 0), (7, 0), (8, 4), (16, 8), (40, 8), (60, 9), (100, 15)]
    )
    def test_min_inliers(self, searched: int, expected: int) -> None:
        assert self.monitor().min_inliers(searched) == expected

    def test_its_settings_count(self) -> None:
        m = self.monitor(seconds=0.05, min_matches=20)
        assert m.min_inliers(100) == 20
        assert m.update(0.0, 19, accepted=True) is Status.COASTING
        assert m.update(0.04, 19, accepted=True) is Status.COASTING
        assert m.update(0.06, 19, accepted=True) is Status.LOST


class TestPlaceRecognition:
    def test_descriptors_know_a_point_at_another_scale(self, images: list[Image]) -> None:
        image, options = images[0], Settings.default().frontend
        uv = detect_corners(image, np.empty((0, 2)), 60, options.detect, 60)
        larger = np.asarray(cv2.resize(image, None, fx=1.5, fy=1.5), np.uint8)
        there = (uv + 0.5) * 1.5 - 0.5
        views = describe_views(capture(image, uv, np.eye(4)), 36.0)
        corners = describe_corners(larger, there, 0.0, 36.0)
        landmark, corner = match_descriptors(views, np.arange(len(uv)), corners, 0.9, 0.8)
        assert len(landmark) > 0.8 * len(uv)
        assert (landmark == corner).mean() > 0.95

    def test_more_views_of_a_landmark_are_no_rivals(self, images: list[Image]) -> None:
        uv = detect_corners(images[0], np.empty((0, 2)), 30, Settings.default().frontend.detect, 60)
        views = np.repeat(describe_views(capture(images[0], uv, np.eye(4)), 36.0), 2, axis=0)
        owner = np.repeat(np.arange(len(uv)), 2)
        landmark, corner = match_descriptors(
            views, owner, describe_corners(images[0], uv, 0.0, 36.0), 0.9, 0.8
        )
        assert len(landmark) == len(uv)
        assert (landmark == corner).all()

    def test_nothing_to_match(self) -> None:
        nothing = np.empty((0, 128), np.float32)
        landmark, corner = match_descriptors(nothing, np.empty(0, np.int64), nothing[None], 0.9, 0.8)
        assert len(landmark) == len(corner) == 0

    def test_a_pose_among_wrong_matches(self, recording: SimulatedRecording) -> None:
        generator = np.random.default_rng(3)
        truth = se3_exp(np.array([0.3, -0.2, 0.1, 0.05, -0.1, 0.2]))
        uv = generator.uniform([20, 20], [700, 460], (40, 2))
        rays = recording.camera.unproject(uv)
        points = (rays * generator.uniform(2.0, 8.0, (40, 1))) @ truth[:3, :3].T + truth[:3, 3]
        uv[:25] = generator.uniform([20, 20], [700, 460], (25, 2))
        found = pose_by_ransac(points, uv, recording.camera, 3.0, 2000)
        assert found is not None
        assert set(range(25, 40)) <= set(found[1].tolist())
        np.testing.assert_allclose(found[0], truth, atol=1e-3)

    def test_no_pose_from_too_little(self, recording: SimulatedRecording) -> None:
        uv = np.array([[100.0, 100.0], [200.0, 100.0], [100.0, 300.0]])
        assert pose_by_ransac(np.ones((3, 3)), uv, recording.camera, 3.0, 100) is None


def test_wrong_matches_leave_a_pose_in_few_rounds(
    recording: SimulatedRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their number does not decide how long a frame takes."""
    rng = np.random.default_rng(5)
    camera = recording.camera
    uv = rng.uniform([30.0, 30.0], [camera.width - 30.0, camera.height - 30.0], (60, 2))
    rays = camera.unproject(uv)
    seen = rays * (rng.uniform(2.0, 6.0, 60) / rays[:, 2])[:, None]
    truth = se3_exp(np.array([0.3, -0.2, 0.1, 0.05, 0.1, -0.02]))
    points = seen @ truth[:3, :3].T + truth[:3, 3]
    wrong = np.arange(60) < 25
    off = rng.standard_normal((25, 2))
    uv[wrong] += off / np.linalg.norm(off, axis=1)[:, None] * np.geomspace(8.0, 80.0, 25)[:, None]
    rounds: list[Any] = []

    def counted(*args: Any) -> Any:
        rounds.append(args)
        return pose_from_points(*args)

    monkeypatch.setattr("collabslam.frontend.place_recognition.pose_from_points", counted)
    guess = truth @ se3_exp(np.array([0.02, 0.01, -0.02, 0.01, -0.01, 0.0]))
    agreed = pose_of_agreeing(points, uv, camera, guess, 4.0)
    assert agreed is not None
    assert agreed[1].tolist() == np.flatnonzero(~wrong).tolist()
    assert np.linalg.norm(se3_log(pose_inverse(agreed[0]) @ truth)) < 1e-6
    assert len(rounds) <= 8

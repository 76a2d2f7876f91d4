"""What is wrong with a recording is found and named: each usual mistake, put into the demo's recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from collabslam import geometry as g
from collabslam._core import Camera
from collabslam.checks import lengths, matching, mistakes, robot, views
from collabslam.checks.alone import focal_range
from collabslam.checks.calibration import check_calibration
from collabslam.checks.mistakes import (
    OPTICAL_FROM_BODY,
    WORN_POSE_MISTAKES,
    MirroredCamera,
    mirrored,
)
from collabslam.checks.trials import Trial, clock_trials
from collabslam.cli import main as cli
from collabslam.datasets.at_frames import AtFrames
from collabslam.datasets.poses import BODY_FROM_OPTICAL, OPENGL_FROM_OPTICAL, interpolate_track
from collabslam.datasets.printed_pose import PRINTED
from collabslam.datasets.wrapped import FirstFrames, WrappedRecording
from collabslam.simulation import corridor_recording
from collabslam.types import Array, Frame, Image, Recording
from collabslam_lab.hardware.free_running import FreeRunning, WornAt, WornClock

pytestmark = pytest.mark.slow

FRAMES = 54
"""Of the demo's recording: Cf is there in the first and in the last fourteen."""
AS_TEXT = sorted(range(FRAMES), key=str)
"""Its frames in the order of their numbers as text."""


class Walk(WrappedRecording):
    """Frames of the demo's recording, with things that a test may put wrong."""

    def __init__(self, base: Recording, frames: list[Frame]) -> None:
        super().__init__(base)
        self.frames = list(frames)
        self.times = base.times[: len(frames)]
        self.truth: Array | None = base.truth[: len(frames)]

    def __len__(self) -> int:
        return len(self.frames)

    def frame(self, i: int) -> Frame:
        return self.frames[i]

    def image(self, i: int) -> Image:
        return self.frames[i].image


@pytest.fixture(scope="module")
def recorded() -> tuple[Recording, list[Frame]]:
    recording = corridor_recording()
    return recording, [recording.frame(i) for i in range(FRAMES)]


def _matched(a: matching.Points, b: matching.Points) -> matching.Matches:
    """Of points that `matching.describe` keeps, so that they are known by where they are."""
    key = id(a.uv), id(b.uv)
    if key not in MATCHED:
        MATCHED[key] = a, b, matching.match_points(a, b)
    return MATCHED[key][2]


MATCHED: dict[tuple[int, int], tuple[matching.Points, matching.Points, matching.Matches]] = {}


@pytest.fixture
def walk(recorded: tuple[Recording, list[Frame]], monkeypatch: pytest.MonkeyPatch) -> Walk:
    """The recording; its images are matched once for all tests."""
    for module in (lengths, robot, views):
        monkeypatch.setattr(module, "match_points", _matched)
    return Walk(*recorded)


def change_images(walk: Walk, change: Callable[[Image], Image]) -> None:
    walk.frames = [replace(f, image=change(f.image)) for f in walk.frames]


def change_views(walk: Walk, change: Callable[[Image], Image]) -> None:
    walk.frames = [
        replace(f, views=tuple(replace(view, image=change(view.image)) for view in f.views))
        for f in walk.frames
    ]


def change_t_cf(walk: Walk, change: Callable[[Array], Array]) -> None:
    walk.frames = [
        replace(f, views=tuple(replace(view, t_cf=change(view.t_cf)) for view in f.views))
        for f in walk.frames
    ]


def change_camera(camera: Camera, focal: float = 1.0, size: float = 1.0) -> Camera:
    fx, fy, cx, cy = (size * x for x in camera.intrinsics)
    intrinsics = focal * fx, focal * fy, cx, cy
    return Camera(camera.model, camera.width, camera.height, intrinsics, camera.distortion)


def across(image: Image) -> Image:
    return mirrored(image, across=True, down=False)


def upside_down(image: Image) -> Image:
    return mirrored(image, across=True, down=True)


def reordered(t: Array, order: tuple[int, ...]) -> Array:
    return g.pose(g.rotation_from_quaternion(g.quaternion_wxyz(t[:3, :3])[list(order)]), t[:3, 3])


def swap(walk: Walk) -> None:
    walk.frames = [
        replace(f, image=f.views[0].image, views=(replace(f.views[0], image=f.image),)) if f.views else f
        for f in walk.frames
    ]


def worn_images_from(walk: Walk, later: int) -> None:
    """Each view's image is that of so many frames later."""
    known = {k: f.views[0].image for k, f in enumerate(walk.frames) if f.views}
    walk.frames = [
        replace(
            f, views=tuple(replace(view, image=known[k + later]) for view in f.views if k + later in known)
        )
        for k, f in enumerate(walk.frames)
    ]


def poses_from(walk: Walk, later: int) -> None:
    """Each view's pose is that of so many frames later."""
    known = {k: f.views[0].t_cf for k, f in enumerate(walk.frames) if f.views}
    walk.frames = [
        replace(
            f, views=tuple(replace(view, t_cf=known[k + later]) for view in f.views if k + later in known)
        )
        for k, f in enumerate(walk.frames)
    ]


def change_truth(walk: Walk, change: Callable[[Array], Array]) -> None:
    assert walk.truth is not None
    walk.truth = np.array([change(t) for t in walk.truth])


MOUNT = g.pose(g.rotation_exp(np.array([0.3, -0.4, 1.5])), np.array([0.02, 0.1, -0.05]))


def by_body(walk: Walk, change: Callable[[Array], Array]) -> None:
    """The true poses came by a T_BS, that of `MOUNT` or its inverse."""
    walk.t_bs = MOUNT
    change_truth(walk, change)


def shift_truth(walk: Walk, seconds: float) -> None:
    base = walk._base
    walk.truth = interpolate_track(base.times, base.truth, walk.times + seconds)


def recalibrate(walk: Walk, name: str, **factors: float) -> None:
    setattr(walk, name, change_camera(getattr(walk, name), **factors))


def turned(t: Array) -> Array:
    """A pose between body axes, of one between optical axes."""
    return BODY_FROM_OPTICAL @ t @ OPTICAL_FROM_BODY


def turned_again(t: Array) -> Array:
    return OPTICAL_FROM_BODY @ t @ BODY_FROM_OPTICAL


def left_handed(t: Array) -> Array:
    """A pose along Unity's axes."""
    flip = np.diag([1.0, -1.0, 1.0, 1.0])
    return flip @ t @ flip


def opengl(t: Array) -> Array:
    """A pose between OpenGL's axes."""
    return OPENGL_FROM_OPTICAL @ t @ OPENGL_FROM_OPTICAL


def lengthen(factor: float) -> Callable[[Array], Array]:
    return lambda t: g.pose(t[:3, :3], factor * t[:3, 3])


TRUE_POSES: list[tuple[str, Callable[[Walk], object], str]] = [
    ("inverse", lambda w: change_truth(w, g.pose_inverse), "The true poses are inverted"),
    ("body", lambda w: change_truth(w, lambda t: t @ OPTICAL_FROM_BODY), "The true poses are of ROS body"),
    ("optical", lambda w: change_truth(w, lambda t: t @ BODY_FROM_OPTICAL), "were turned to optical axes"),
    ("wxyz", lambda w: change_truth(w, lambda t: reordered(t, (3, 0, 1, 2))), "w x y z where x y z w"),
    ("xyzw", lambda w: change_truth(w, lambda t: reordered(t, (1, 2, 3, 0))), "x y z w where w x y z"),
    ("clock +0.3", lambda w: shift_truth(w, 0.3), "with -0.3"),
    ("clock -0.1", lambda w: shift_truth(w, -0.1), "with +0."),
    ("mirror", lambda w: change_images(w, across), "The images of Cs are mirrored left to right"),
    ("hung", lambda w: change_images(w, upside_down), "The images of Cs are upside down"),
    ("focal", lambda w: recalibrate(w, "camera", focal=1.1), "of Cs does not fit, 0.91"),
    ("short", lambda w: recalibrate(w, "camera", focal=0.9), "of Cs does not fit, 1.11"),
    ("size", lambda w: recalibrate(w, "camera", size=2.0), "scaled after the calibration, by 0.50"),
    ("opengl", lambda w: change_truth(w, lambda t: t @ OPENGL_FROM_OPTICAL), "--poses-axes opengl"),
    ("unity", lambda w: change_truth(w, left_handed), "or its poses are left-handed (Unity"),
    ("T_BS", lambda w: by_body(w, lambda t: t @ MOUNT @ MOUNT), "T_BS of Cs is inverted"),
    ("order", lambda w: setattr(w, "truth", w.truth[AS_TEXT]), "The poses are in the order of"),
]  # fmt: skip


@pytest.mark.parametrize(("put", "said"), [m[1:] for m in TRUE_POSES], ids=[m[0] for m in TRUE_POSES])
def test_a_mistake_that_true_poses_show(walk: Walk, put: Callable[[Walk], object], said: str) -> None:
    put(walk)
    walk.worn_camera = None
    report = check_calibration(walk)
    assert said in report.findings[0]
    assert "falls from" in report.findings[0] or "lie before the camera, not" in report.findings[0]
    assert not report.agrees


T_CF: list[tuple[str, Callable[[Walk], object], str]] = [
    ("inverse", lambda w: change_t_cf(w, g.pose_inverse), "T_CF is inverted"),
    ("body", lambda w: change_t_cf(w, turned), "T_CF is along ROS body axes"),
    ("optical", lambda w: change_t_cf(w, turned_again), "T_CF was turned to optical axes"),
    ("robot's body", lambda w: change_t_cf(w, lambda t: BODY_FROM_OPTICAL @ t), "leads into Cs's body axes"),
    ("worn body", lambda w: change_t_cf(w, lambda t: t @ OPTICAL_FROM_BODY), "starts from Cf's body axes"),
    ("wxyz", lambda w: change_t_cf(w, lambda t: reordered(t, (3, 0, 1, 2))), "w x y z where x y z w"),
    ("xyzw", lambda w: change_t_cf(w, lambda t: reordered(t, (1, 2, 3, 0))), "x y z w where w x y z"),
    ("opengl", lambda w: change_t_cf(w, opengl), "--t-cf-axes opengl"),
    ("unity", lambda w: change_t_cf(w, left_handed), "poses are left-handed (Unity"),
    ("swapped", swap, "The images of Cs and Cf are swapped"),
    ("mirror", lambda w: change_views(w, across), "The images of Cf are mirrored left to right"),
    ("hung", lambda w: change_views(w, upside_down), "The images of Cf are upside down"),
    ("both mirrored", lambda w: (change_images(w, across), change_views(w, across)), "of both cameras"),
    ("size", lambda w: recalibrate(w, "worn_camera", size=0.5), "scaled after the calibration, by 2.00"),
    ("images 0.3 early", lambda w: worn_images_from(w, 3), "images of Cf are stamped 0.30 s too early"),
    ("images 0.2 early", lambda w: worn_images_from(w, 2), "images of Cf are stamped 0.20 s too early"),
    ("images 0.1 early", lambda w: worn_images_from(w, 1), "images of Cf are stamped 0.10 s too early"),
    ("images 0.1 late", lambda w: worn_images_from(w, -1), "images of Cf are stamped 0.10 s too late"),
    ("images 0.2 late", lambda w: worn_images_from(w, -2), "images of Cf are stamped 0.20 s too late"),
    ("images 0.3 late", lambda w: worn_images_from(w, -3), "images of Cf are stamped 0.30 s too late"),
    ("poses late", lambda w: poses_from(w, -3), "The poses T_CF are stamped"),
    ("focal", lambda w: recalibrate(w, "worn_camera", focal=1.1), "focal length of C"),
    ("millimetres", lambda w: change_t_cf(w, lengthen(1000.0)), "m long: no two cameras see one scene"),
]  # fmt: skip


def test_what_t_bs_did_wrong_is_undone() -> None:
    true, other = g.pose(g.rotation_exp(np.array([0.1, 0.2, 0.3])), np.array([1.0, 2.0, 3.0])), MOUNT @ MOUNT
    inverted, own = mistakes.body_mistakes(MOUNT)
    np.testing.assert_allclose(inverted.undo(true @ MOUNT @ MOUNT), true, atol=1e-12)
    np.testing.assert_allclose(own.undo(true @ MOUNT), true, atol=1e-12)
    (both,) = mistakes.rig_mistakes(MOUNT)  # of cameras whose T_BS are the inverses of MOUNT and of `other`
    np.testing.assert_allclose(
        both.undo(g.pose_inverse(MOUNT) @ other), MOUNT @ g.pose_inverse(other), atol=1e-12
    )
    assert mistakes.body_mistakes(None) == mistakes.rig_mistakes(None) == ()


@pytest.mark.parametrize(("put", "said"), [m[1:] for m in T_CF], ids=[m[0] for m in T_CF])
def test_a_mistake_that_cf_shows_without_true_poses(
    walk: Walk, monkeypatch: pytest.MonkeyPatch, put: Callable[[Walk], object], said: str
) -> None:
    monkeypatch.setattr("collabslam.checks.calibration.focal_range", lambda *_: None)
    put(walk)
    walk.truth = None
    report = check_calibration(walk)
    assert len(report.findings) == 1
    assert said in report.findings[0]
    assert not report.agrees
    assert any("no true poses" in note for note in report.notes)


@pytest.mark.parametrize(("factor", "said"), [(1000.0, "millimetres"), (1.0 / 0.3048, "feet")])
def test_the_unit_of_t_cf(walk: Walk, factor: float, said: str) -> None:
    change_t_cf(walk, lengthen(factor))
    report = check_calibration(walk)
    assert report.lengths == pytest.approx(1.0 / factor, rel=0.15)
    assert report.findings[0].startswith(f"T_CF is in {said}")


def test_what_epipolar_lines_do_not_tell_is_told_by_depth(walk: Walk) -> None:
    """Poses of OpenGL's axes fit mirrored images as well, but everything is behind the camera then."""
    change_truth(walk, lambda t: t @ OPENGL_FROM_OPTICAL)
    change_images(walk, across)
    walk.worn_camera = None
    report = check_calibration(walk)
    assert max(report.by_gap.values()) < 1.0
    assert "only 0 % of the points lie before the camera" in report.findings[0]
    assert not report.agrees


def test_an_inverse_that_only_depth_tells(walk: Walk) -> None:
    """Of a T_CF that hardly turns the inverse has the same epipolar lines, and all points behind."""
    later = 4
    for k, f in enumerate(walk.frames[:-later]):
        away = g.pose_inverse(walk.truth[k + later]) @ walk.truth[k]  # of Cs, by which it will have moved
        views = tuple(replace(view, image=walk.frames[k + later].image, t_cf=away) for view in f.views)
        walk.frames[k] = replace(f, views=views)
    walk.frames = walk.frames[:-later]
    walk.times, walk.truth, walk.worn_camera = walk.times[:-later], walk.truth[:-later], walk.camera
    report = check_calibration(walk)
    assert "T_CF is inverted" in report.findings[0]


def test_a_pose_of_cf_30_cm_off(walk: Walk) -> None:
    change_t_cf(walk, lambda t: g.pose(t[:3, :3], t[:3, 3] + [0.3, 0.0, 0.0]))
    report = check_calibration(walk)
    assert "contradicts the images" in report.findings[0]
    assert "no usual mistake" in report.findings[0]
    assert report.worn.error.metres == pytest.approx(0.3, abs=0.1)


def opens(walk: Walk, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever a command is given, it opens this recording."""
    source = SimpleNamespace(open=lambda: walk)
    monkeypatch.setattr("collabslam.cli.options.source_with_worn", lambda arguments: source)


def test_a_good_recording(
    walk: Walk, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    report = check_calibration(walk)
    assert not report.findings
    assert max(report.by_gap.values()) < 0.7
    assert report.focal == pytest.approx(1.0, abs=0.02)
    assert report.offset == pytest.approx(0.0, abs=0.02)
    assert report.lengths == pytest.approx(1.0, abs=0.15)
    assert report.worn.error.sigmas < 2.0
    # The stated noise of T_CF is worth more than 4 px: nothing is wrong, and nothing "agrees".
    assert report.worn.residual == pytest.approx(report.worn.expected, rel=0.3)
    assert report.agrees == (report.worn.residual <= 4.0)
    opens(walk, monkeypatch)
    assert cli.main(["check-calib", "demo"]) == 0
    shown = capsys.readouterr().out
    assert ("agree with the images, as far" in shown) == report.agrees
    assert ("speaks against" in shown) != report.agrees
    assert "the images cannot confirm it more finely" in shown


def test_exact_poses_of_cf_agree(walk: Walk) -> None:
    base = walk._base
    walk.frames = [
        replace(f, views=tuple(replace(view, t_cf=base.true_t_cf(f.index)) for view in f.views))
        for f in walk.frames
    ]
    report = check_calibration(walk)
    assert report.agrees
    assert report.worn.residual < 1.0


def test_nothing_to_compare_is_not_fine(
    walk: Walk, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    walk.truth = np.repeat(walk.truth[:1], len(walk), axis=0)
    walk.worn_camera = None
    opens(walk, monkeypatch)
    assert cli.main(["check-calib", "demo"]) == 1
    shown = capsys.readouterr().out
    assert "are not held against the poses" in shown
    assert "agree" not in shown
    assert "speaks against" not in shown


def test_views_without_t_cf_are_told_as_such(walk: Walk) -> None:
    walk.frames = [replace(f, views=()) for f in walk.frames]
    assert "No view of Cf has a T_CF: its calibration" in " ".join(check_calibration(walk).notes)
    walk.worn_pose = PRINTED
    notes = " ".join(check_calibration(walk).notes)
    assert "The printed target of T_CF was never seen by both cameras: its" in notes


@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_the_focal_length_from_images_alone(monkeypatch: pytest.MonkeyPatch, factor: float) -> None:
    """A camera that swings about a cloud of points; the calibration has another focal length."""
    camera = Camera("pinhole", 640, 480, (500.0, 500.0, 319.5, 239.5))
    points = np.random.default_rng(2).uniform((-3, -2, 4), (3, 2, 9), (300, 3))
    noise = np.random.default_rng(3).normal(0.0, 0.3, (30, 300, 2))

    def see(k: int) -> tuple[Array, Array]:
        t = g.se3_exp(
            [0.3 * k, 0.8 * np.sin(k), 0.0, 0.2 * np.cos(k), -0.05 * k + 0.5, 0.3 * np.sin(0.7 * k)]
        )
        there = camera.project((points - t[:3, 3]) @ t[:3, :3])
        return there.uv + noise[k], there.visible

    def match(a: int, b: int) -> matching.Matches:
        (uv_a, in_a), (uv_b, in_b) = see(a), see(b)
        return matching.Matches(uv_a[in_a & in_b], uv_b[in_a & in_b])

    monkeypatch.setattr("collabslam.checks.alone.describe", lambda image: image)
    monkeypatch.setattr("collabslam.checks.alone.match_points", match)
    found = focal_range(lambda k: k, range(30), MirroredCamera(camera).with_focal(factor))
    assert found is not None
    assert found.contradicts == (factor != 1.0)
    assert found.least * factor <= 1.0 <= found.most * factor
    assert found.most / found.least < 1.5


def test_images_that_stand_still_tell_no_focal_length(tmp_path: Path) -> None:
    image = np.random.default_rng(1).integers(0, 255, (120, 160), np.uint8)
    camera = Camera("pinhole", 160, 120, (100.0, 100.0, 79.5, 59.5))
    assert focal_range(lambda k: image, range(12), MirroredCamera(camera)) is None


def test_without_true_poses_a_clock_may_be_a_focal_length() -> None:
    """A frame later everything straight ahead is larger, as with a longer focal length."""
    views: Any = [SimpleNamespace(matches={-1: None, 0: None, 1: None, 2: None})]
    for alone in (True, False):
        trials = list(clock_trials(cast(Any, (None, None)), views, 0.1, alone=alone))
        images = [trial for trial in trials if "images" in trial.fault]
        named = {trial.fault for trial in images if "focal length" in trial.remedy}
        assert len(images) == 6
        assert all("0.10 s" in fault for fault in named)
        assert len(named) == (2 if alone else 0)


@pytest.fixture
def free_running(recorded: tuple[Recording, list[Frame]], walk: Walk) -> FreeRunning:
    """Cf takes its views at 7 Hz, between frames; each comes 0.3 s late."""
    return FreeRunning(walk, _views_of(recorded[0]), WornClock(7.0, 0.04, 0.3))


@cache
def _views_of(recording: Any) -> WornAt:
    """What Cf sees at any time, each picture drawn once."""
    return cache(recording.worn_at)


def test_a_worn_camera_with_a_clock_of_its_own_is_checked(free_running: FreeRunning) -> None:
    report = check_calibration(free_running)
    assert report.worn.agrees
    assert report.worn.error is not None
    assert report.worn.error.metres < 0.06  # its noise is 3 cm along each axis
    assert report.lengths == pytest.approx(1.0, abs=0.15)
    assert report.findings == []


@pytest.mark.parametrize(
    ("change", "said"), [(g.pose_inverse, "is inverted"), (turned, "along ROS body axes")]
)
def test_a_mistake_in_poses_between_frames(
    free_running: FreeRunning, change: Callable[[Array], Array], said: str
) -> None:
    report = check_calibration(Changed(free_running, change))
    assert said in report.findings[0]
    assert len(report.findings) == 1
    assert report.lengths == pytest.approx(1.0, abs=0.15)


def test_a_mistake_is_undone_in_what_was_given() -> None:
    """Not in what was carried to the frame: who made the mistake did so before."""
    given, moved = g.se3_exp([0.5, -0.2, 1.2, 0.1, -0.5, 0.2]), g.se3_exp([0.1, 0.0, 0.2, 0.0, 0.1, 0.0])
    view = views.View(0, 0, {}, {0: given}, moved, np.eye(6))
    for mistake in WORN_POSE_MISTAKES:
        trial = Trial("", "", cast(Any, (None, None)), mistake=mistake)
        assert np.allclose(trial.t_cf(view), moved @ mistake.undo(given))


def test_without_true_poses_the_motion_to_the_nearest_frame_is_noise(free_running: FreeRunning) -> None:
    without = FirstFrames(free_running, 30)
    exact = AtFrames(without, without.truth)
    without.truth = None
    vague = AtFrames(without)
    assert exact.free
    told, untold = exact.frame(10).views[0], vague.frame(10).views[0]
    assert told.t is not None
    assert told.t == untold.t
    assert np.array_equal(told.t_cf, untold.t_cf)
    off = abs(told.t - float(without.times[10]))
    assert off > 0.01
    assert np.linalg.norm(exact.moved(10)[:3, 3]) == pytest.approx(1.5 * off, rel=0.3)
    assert np.array_equal(vague.moved(10), np.eye(4))
    grown = np.sqrt(np.diag(untold.covariance - told.covariance))
    assert np.all(grown[3:] == pytest.approx(0.5 * off))
    assert np.all(grown[:3] >= off - 1e-9)
    assert "clock of its own" in check_calibration(without).notes[-2]


class Changed(WrappedRecording):
    """T_CF as somebody gives it by mistake."""

    def __init__(self, base: Recording, change: Callable[[Array], Array]) -> None:
        super().__init__(base)
        self._change = change

    def frame(self, i: int) -> Frame:
        frame = self._base.frame(i)
        return replace(
            frame, views=tuple(replace(view, t_cf=self._change(view.t_cf)) for view in frame.views)
        )

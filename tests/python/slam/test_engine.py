"""The engine on the first frames of the demo: all modes, repeatability, loss of sight, bad input."""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import geometry as g
from collabslam.errors import InputError, SettingsError
from collabslam.results import StepResult
from collabslam.runs.results import DIAGNOSTICS
from collabslam.settings.modes import MODES
from collabslam.slam.engine import Slam
from collabslam.types import Frame, Status, WornView


class Run:
    """A mode played over the clip."""

    def __init__(self, clip: Clip, mode: str, count: int | None = None, **options: Any) -> None:
        recording = clip.recording
        self.slam = Slam(recording.camera, recording.worn_camera, mode=mode, **options)
        self.maps = []
        self.steps: list[StepResult] = []
        for frame in clip.frames[:count]:
            self.steps.append(self.slam.step(frame.t, frame.image, frame.views))
            self.maps.append(self.slam.landmarks())


@pytest.fixture(scope="module")
def runs(clip: Clip) -> Any:
    """Each mode's run over the whole clip, made when it is first asked for."""
    return cache(lambda mode: Run(clip, mode))


def _state(slam: Slam) -> tuple[object, ...]:
    core = slam.filter
    return (core.mean.tobytes(), core.covariance.tobytes(), core.time, core.blocks, core.candidates.tobytes())


@pytest.mark.parametrize("mode", MODES)
class TestEachMode:
    @pytest.mark.slow
    def test_poses_are_sound(self, runs: Any, mode: str) -> None:
        for step in runs(mode).steps:
            assert np.isfinite(step.pose).all()
            np.testing.assert_allclose(step.pose[:3, :3] @ step.pose[:3, :3].T, np.eye(3), atol=1e-9)
            np.testing.assert_array_equal(step.pose[3], [0, 0, 0, 1])
            np.testing.assert_allclose(step.covariance, step.covariance.T, atol=1e-15)
            assert np.linalg.eigvalsh(step.covariance).min() > -1e-12
        assert runs(mode).slam.filter.soundness() > -1e-10

    def test_it_starts_at_once_and_keeps_sight(self, runs: Any, mode: str) -> None:
        for step in runs(mode).steps:
            assert step.started
            assert step.valid
            assert step.status is Status.OK

    def test_it_follows_the_walk(self, clip: Clip, runs: Any, mode: str) -> None:
        last = len(clip.frames) - 1
        truth = np.linalg.inv(clip.recording.truth[0]) @ clip.recording.truth[last]
        step = runs(mode).steps[last]
        error = step.pose[:3, 3] - truth[:3, 3]
        length = np.linalg.norm(truth[:3, 3])
        assert np.linalg.norm(error) < 0.3 * length

    def test_diagnostics_are_complete(self, runs: Any, mode: str) -> None:
        always = set(DIAGNOSTICS) - {"cf_rate_used", "cf_rate_contradicted"}  # where a view tells its rate
        for step in runs(mode).steps:
            d = step.diagnostics
            assert always <= set(d)
            assert d["found"] <= d["searched"] <= d["predicted"]
            stages = ("predict", "search", "cf", "update", "map")
            assert d["ms_total"] >= 0.999 * sum(d[f"ms_{s}"] for s in stages)


@pytest.mark.parametrize("mode", ["mono", "collab-tight"])
def test_two_runs_are_alike_to_the_bit(clip: Clip, runs: Any, mode: str) -> None:
    first, again = runs(mode), Run(clip, mode)
    assert _state(first.slam) == _state(again.slam)
    for a, b in zip(first.steps, again.steps, strict=True):
        assert a.pose.tobytes() == b.pose.tobytes()
        assert a.covariance.tobytes() == b.covariance.tobytes()
        same = {k: v for k, v in a.diagnostics.items() if not k.startswith("ms_")}
        np.testing.assert_equal({k: b.diagnostics[k] for k in same}, same)


def test_mono_takes_only_its_start_from_the_worn_camera(clip: Clip, runs: Any) -> None:
    mono, tight = runs("mono"), runs("collab-tight")
    assert mono.steps[0].pose.tobytes() == tight.steps[0].pose.tobytes()
    assert mono.maps[0].points.tobytes() == tight.maps[0].points.tobytes()
    assert mono.maps[0].covariance.tobytes() == tight.maps[0].covariance.tobytes()
    assert mono.steps[0].diagnostics["cf_matches"] > 0
    assert sum(bool(f.views) for f in clip.frames[1:]) > 5
    assert all(s.diagnostics["cf_matches"] == 0 for s in mono.steps[1:])
    assert all(s.diagnostics["births_instant"] == 0 for s in mono.steps[1:])
    assert sum(s.diagnostics["cf_matches"] for s in tight.steps[1:]) > 50


def test_collab_uses_depth_and_tight_uses_pixels(runs: Any) -> None:
    def total(mode: str, key: str) -> int:
        return sum(s.diagnostics[key] for s in runs(mode).steps[1:])

    assert total("collab", "depth_rows") > 0
    assert total("collab", "cf_pixel_rows") == 0
    assert total("collab-tight", "cf_pixel_rows") > 0
    assert total("collab-tight", "depth_rows") == 0
    assert total("collab-init", "depth_rows") == total("collab-init", "cf_pixel_rows") == 0


def test_in_the_dark_it_coasts_and_then_is_lost(clip: Clip) -> None:
    run = Run(clip, "mono", 3)
    black = np.zeros_like(clip.frames[0].image)
    t = clip.frames[2].t
    dark = [run.slam.step(t + 0.1 * k, black) for k in range(1, 13)]
    assert [s.status for s in dark] == [Status.COASTING] * 2 + [Status.LOST] * 10
    assert [s.valid for s in dark] == [True] * 2 + [False] * 10
    assert all(s.diagnostics["accepted"] == 0 for s in dark)
    traces = [np.trace(s.covariance[:3, :3]) for s in (run.steps[-1], *dark)]
    assert (np.diff(traces) > 0).all()
    assert all(np.isfinite(s.pose).all() for s in dark)


class Turned:
    """A filter whose attitude is known to ``sd`` radians about one axis."""

    def __init__(self, core: Any, sd: float) -> None:
        self._core, self._variance = core, sd**2

    @property
    def pose_covariance(self) -> Any:
        return self._core.pose_covariance + np.diag([0.0, 0.0, 0.0, 0.0, self._variance, 0.0])

    def __getattr__(self, name: str) -> Any:
        return getattr(self._core, name)


def test_an_attitude_that_nobody_knows_degrades(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the map says; the map goes on."""
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    said = []
    for frame, sd in zip(clip.frames, (0.0, 0.3, 0.4, 0.4, 0.3), strict=False):
        monkeypatch.setattr(slam._parts.verdict, "_filter", Turned(slam.filter, sd))
        step = slam.step(frame.t, frame.image, frame.views)
        said.append((step.status, step.diagnostics["degraded_by"], step.valid))
    fine, turned = (Status.OK, "", True), (Status.DEGRADED, "attitude", True)
    assert said == [fine, fine, turned, turned, fine]


def test_before_the_first_overlap_nothing_is_valid(clip: Clip) -> None:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    step = slam.step(0.0, clip.frames[0].image)
    assert not step.started
    assert not step.valid
    assert step.status is not Status.OK
    np.testing.assert_array_equal(step.pose, np.eye(4))
    frame = clip.frames[1]
    assert slam.step(frame.t, frame.image, frame.views).valid


def test_scale_free_start(clip: Clip) -> None:
    slam = Slam(clip.recording.camera, mode="mono", start="scale-free")
    steps = [slam.step(f.t, f.image) for f in clip.frames]
    first = next(k for k, s in enumerate(steps) if s.started)
    assert 0 < first < 10  # one view says nothing of the motion, a few do
    assert not any(s.valid for s in steps[:first])
    assert steps[first].diagnostics["births_instant"] > 20
    assert all(s.status is Status.OK for s in steps[first + 1 :])
    assert all(s.diagnostics["cf_matches"] == 0 for s in steps)
    true = np.array([np.linalg.inv(clip.recording.truth[0]) @ p for p in clip.recording.truth[: len(steps)]])
    for k in range(first, len(steps)):
        turn = steps[k].pose[:3, :3].T @ true[k][:3, :3]
        assert np.linalg.norm(g.rotation_log(turn)) < np.radians(1.0)
        along = steps[k].pose[:3, 3] @ true[k][:3, 3]
        assert along > 0.98 * np.linalg.norm(steps[k].pose[:3, 3]) * np.linalg.norm(true[k][:3, 3])


def test_a_scale_free_start_that_waits_goes_on_from_a_file(clip: Clip, tmp_path: Path) -> None:
    slam = Slam(clip.recording.camera, mode="mono", start="scale-free")
    assert not slam.step(clip.frames[0].t, clip.frames[0].image).started
    slam.save(tmp_path / "waits")
    again = Slam.load(tmp_path / "waits")
    for f in clip.frames[1:6]:
        a, b = slam.step(f.t, f.image), again.step(f.t, f.image)
        assert a.pose.tobytes() == b.pose.tobytes()
    assert a.started


def test_a_camera_that_stands_does_not_start_scale_free(clip: Clip) -> None:
    slam = Slam(clip.recording.camera, mode="mono", start="scale-free")
    noise = np.random.default_rng(0)
    still = clip.frames[0].image.astype(int)
    for k in range(8):
        image = np.clip(still + noise.integers(-2, 3, still.shape), 0, 255).astype(np.uint8)
        step = slam.step(0.1 * k, image)
        assert not step.started
        assert step.status is not Status.OK


def _worn(frame: Frame, **changes: Any) -> WornView:
    assert frame.views
    return dataclasses.replace(frame.views[0], **changes)


class TestBadInput:
    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (lambda i: i[:, :-1], "720 x 480"),
            (lambda i: i.T, "720 x 480"),
            (lambda i: i.astype(np.float32), "uint8"),
            (lambda i: np.dstack([i, i, i]), "grey"),
            (lambda i: i.tolist(), "uint8"),
            (lambda i: None, "uint8"),
        ],
    )
    def test_image(self, clip: Clip, change: Any, words: str) -> None:
        run = Run(clip, "mono", 2)
        before = _state(run.slam)
        frame = clip.frames[2]
        with pytest.raises(InputError, match=words):
            run.slam.step(frame.t, change(frame.image))
        assert _state(run.slam) == before
        assert run.slam.step(frame.t, frame.image).status is Status.OK

    @pytest.mark.parametrize("t", [0.1, 0.05, -1.0, float("nan"), float("inf"), "now", None])
    def test_time(self, clip: Clip, t: Any) -> None:
        run = Run(clip, "mono", 2)
        before = _state(run.slam)
        with pytest.raises(InputError, match="time"):
            run.slam.step(t, clip.frames[2].image)
        assert _state(run.slam) == before

    @pytest.mark.parametrize("image", [np.zeros((48, 72), np.uint8), np.zeros((480, 720))])
    def test_worn_image(self, clip: Clip, image: Any) -> None:
        run = Run(clip, "mono", 1)
        before = _state(run.slam)
        frame = clip.frames[1]
        with pytest.raises(InputError, match="worn image"):
            run.slam.step(frame.t, frame.image, [_worn(frame, image=image)])
        assert _state(run.slam) == before

    def test_worn_view_without_its_calibration(self, clip: Clip) -> None:
        slam = Slam(clip.recording.camera, start="scale-free")
        before = _state(slam)
        frame = clip.frames[0]
        with pytest.raises(InputError, match="worn_camera"):
            slam.step(frame.t, frame.image, frame.views)
        assert _state(slam) == before

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"t_cf": np.eye(3)}, "t_cf"),
            ({"t_cf": np.full((4, 4), np.nan)}, "t_cf has a value"),
            ({"t_cf": np.diag([2.0, 1.0, 1.0, 1.0])}, "rotation"),
            ({"covariance": np.eye(5)}, "covariance"),
            ({"covariance": np.full((6, 6), np.nan)}, "covariance"),
            ({"covariance": -np.eye(6)}, "covariance"),
        ],
    )
    def test_worn_pose(self, clip: Clip, changes: dict[str, Any], words: str) -> None:
        run = Run(clip, "collab", 1)
        before = _state(run.slam)
        frame = clip.frames[1]
        with pytest.raises(InputError, match=words):
            run.slam.step(frame.t, frame.image, [_worn(frame, **changes)])
        assert _state(run.slam) == before

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            ({"mode": "stereo"}, "mode 'stereo'"),
            ({"start": "soon"}, "start 'soon'"),
            ({"start": "worn"}, "worn_camera"),
            ({"start": "target"}, "target"),
        ],
    )
    def test_options(self, clip: Clip, options: dict[str, str], words: str) -> None:
        with pytest.raises(SettingsError, match=words):
            Slam(clip.recording.camera, **options)

"""What is wrong with a recording is found and named: focal length, clock, pose of Cf."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import Clip

from collabslam import geometry as g
from collabslam._core import Camera
from collabslam.checks import calibration, worn
from collabslam.checks.matching import Matches
from collabslam.cli import main as cli
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.types import Frame, WornView


class Part(WrappedRecording):
    """The clip's frames, with things that a test may put wrong."""

    def __init__(self, clip: Clip) -> None:
        super().__init__(clip.recording)
        count = len(clip.frames)
        self.frames = clip.frames
        self.times, self.truth = self.times[:count], self.truth[:count]

    def __len__(self) -> int:
        return len(self.frames)

    def frame(self, i: int) -> Frame:
        return self.frames[i]

    def image(self, i: int) -> np.ndarray:
        return self.frames[i].image


class _Sized:
    """Forty frames with the attributes of another object."""

    def __init__(self, base: SimpleNamespace) -> None:
        self.__dict__.update(vars(base))

    def __len__(self) -> int:
        return 40


@pytest.fixture
def part(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> Part:
    monkeypatch.setattr(calibration, "GAPS", (2, 5))
    monkeypatch.setattr(calibration, "PAIRS_PER_GAP", 4)
    monkeypatch.setattr(worn, "VIEWS", 4)
    return Part(clip)


def test_a_good_recording(
    part: Part, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("collabslam.datasets.open_recording", lambda source, **_: part)
    assert cli.main(["check-calib", "demo"]) == 0
    assert "agree with the images" in capsys.readouterr().out
    report = calibration.check_calibration(part)
    assert set(report.by_gap) == {2, 5}
    assert max(report.by_gap.values()) < 0.7
    assert report.focal == pytest.approx(1.0, abs=0.02)
    assert report.offset == pytest.approx(0.0, abs=0.02)
    assert report.worn.error.sigmas < 2.0


def test_another_focal_length(part: Part) -> None:
    c = part.camera
    fx, fy, cx, cy = c.intrinsics
    part.camera = Camera(c.model, c.width, c.height, (1.15 * fx, 1.15 * fy, cx, cy), c.distortion)
    part.worn_camera = None
    report = calibration.check_calibration(part)
    assert report.focal == pytest.approx(1 / 1.15, abs=0.03)
    assert "focal length does not fit" in report.findings[0]


@pytest.mark.parametrize("late", [0.0, 0.13])
def test_late_stamps(monkeypatch: pytest.MonkeyPatch, late: float) -> None:
    """Points seen without error from a winding path whose poses are stamped late."""
    camera = Camera("pinhole", 640, 480, (500.0, 500.0, 319.5, 239.5))
    points = np.random.default_rng(2).uniform((-6, -4, 4), (6, 4, 12), (400, 3))
    times = 0.1 * np.arange(40)

    def path(t: float) -> np.ndarray:
        return g.se3_exp(
            [0.4 * np.sin(1.5 * t), 0.1 * t, 0.3 * t, 0.1 * np.sin(t), 0.3 * np.sin(1.2 * t), 0.0]
        )

    def see(t: float) -> tuple[np.ndarray, np.ndarray]:
        t_wc = path(t)
        return camera.project((points - t_wc[:3, 3]) @ t_wc[:3, :3])

    def match(a: np.ndarray, b: np.ndarray) -> Matches:
        (uv_a, ok_a), (uv_b, ok_b) = see(times[a[0, 0]]), see(times[b[0, 0]])
        return Matches(uv_a[ok_a & ok_b], uv_b[ok_a & ok_b])

    recording = SimpleNamespace(
        times=times, truth=np.array([path(t - late) for t in times]), camera=camera, worn_camera=None,
        image=lambda i: np.full((1, 1), i),
    )  # fmt: skip
    monkeypatch.setattr(calibration, "match_images", match)
    report = calibration.check_calibration(_Sized(recording))
    assert report.offset == pytest.approx(late, abs=0.01)
    assert bool(report.findings) == (late > 0.0)
    assert all("time stamps do not fit" in f for f in report.findings)


@pytest.mark.parametrize("late", [0.0, 0.08])
def test_a_pose_of_cf_that_comes_late(monkeypatch: pytest.MonkeyPatch, late: float) -> None:
    """Cf swings; its images are stamped later than its measured poses."""
    camera = Camera("pinhole", 640, 480, (500.0, 500.0, 319.5, 239.5))
    points = np.random.default_rng(3).uniform((-4, -3, 4), (4, 3, 9), (400, 3))
    times = 0.1 * np.arange(40)

    def swing(t: float) -> np.ndarray:
        return g.se3_exp(
            [0.5 + 0.1 * np.sin(3 * t), 0.1, 0.0, 0.0, 0.3 * np.sin(2.0 * t), 0.1 * np.cos(2.5 * t)]
        )

    def frame(i: int) -> Frame:
        view = WornView(np.full((1, 1), i), swing(times[i]), 1e-4 * np.eye(6))
        return Frame(i, times[i], np.full((1, 1), i), view)

    def match(a: np.ndarray, b: np.ndarray) -> Matches:
        t_cf = swing(times[b[0, 0]] + late)
        (uv_a, ok_a), (uv_b, ok_b) = (
            camera.project(points),
            camera.project((points - t_cf[:3, 3]) @ t_cf[:3, :3]),
        )
        return Matches(uv_a[ok_a & ok_b], uv_b[ok_a & ok_b])

    recording = SimpleNamespace(times=times, truth=None, camera=camera, worn_camera=camera, frame=frame)
    monkeypatch.setattr(worn, "match_images", match)
    report = calibration.check_calibration(_Sized(recording))
    assert (report.worn.offset or 0.0) == pytest.approx(late, abs=0.015)
    assert bool(report.findings) == (late > 0.0)
    assert all("of Cf and of T_CF do not agree" in f for f in report.findings)


def test_a_pose_of_cf_that_maps_the_other_way(part: Part) -> None:
    part.truth = None
    part.frames = [
        f if f.worn is None else replace(f, worn=replace(f.worn, t_cf=g.pose_inverse(f.worn.t_cf)))
        for f in part.frames
    ]
    report = calibration.check_calibration(part)
    assert "contradicts the images" in report.findings[0]
    assert "There are no true poses" in report.notes[0]
    assert report.worn.error.sigmas > 3.0


def test_too_little_to_compare(part: Part, tmp_path: Path) -> None:
    part.truth = np.repeat(part.truth[:1], len(part), axis=0)
    part.worn_camera = None
    report = calibration.check_calibration(part)
    assert not report.findings
    assert "are not checked" in report.notes[0]

"""A printed tag that Cf alone sees: Cs passed it, and whoever wears Cf looks back at it."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from helpers.clip import Clip
from helpers.posted import Posted, paint

from collabslam import RecordingWriter, Slam, Tag, WornView
from collabslam.cli import main as cli
from collabslam.geometry import pose, pose_inverse, rotation_exp, se3_exp, se3_log
from collabslam.results import StepResult
from collabslam.settings.table import Settings
from collabslam.simulation.rendered import NOTHING_LASTS
from collabslam.types import Array
from collabslam_lab.switches import with_switches

pytestmark = pytest.mark.slow

TAG = Tag("36h11", 3, 0.24)
PLACE = pose(rotation_exp([0.1, 0.6, 0.05]), [0.15, 0.0, 2.3])
"""Beside the corridor's way, seen from where Cs starts."""
SD = np.repeat([0.02, 0.005], 3)
"""Of T_CF, metres and radians."""
PASSED, LAST = 24, 34
"""Frames: long after the tag has left Cs's view, and the end."""


class Walk:
    """Frames of the corridor with the tag, and views of Cf, which stands before it in an empty room."""

    def __init__(self, clip: Clip) -> None:
        self.recording = clip.recording
        self.start = self.recording.truth[0]
        self.posted = Posted(self.recording, [(TAG, self.start @ PLACE)])
        self.generator = np.random.default_rng(5)

    def view(self, i: int, moved: Array | None = None, t: float | None = None) -> WornView:
        """Of the time of frame ``i``; of a tag that hangs elsewhere by now, if it was ``moved``."""
        camera, tag = self.posted.worn_camera, self.start @ PLACE
        t_wf = tag @ pose_inverse(pose(rotation_exp([0.0, 0.5, 0.0]), [0.1, 0.05, 1.5]))
        wall = self.generator.normal(120.0, 2.0, (camera.height, camera.width)).astype(np.uint8)
        image = paint(wall, camera, t_wf, TAG, tag if moved is None else tag @ moved)
        true = pose_inverse(self.recording.truth[i]) @ t_wf
        measured = true @ se3_exp(-SD * self.generator.standard_normal(6))
        return WornView(image, measured, np.diag(SD**2), NOTHING_LASTS, t=t)

    def step(self, slam: Slam, i: int, *views: WornView) -> StepResult:
        return slam.step(self.recording.times[i], self.posted.image(i), views)

    def error(self, result: StepResult, i: int) -> Array:
        return np.asarray(
            se3_log(pose_inverse(result.pose) @ pose_inverse(self.start) @ self.recording.truth[i])
        )


@pytest.fixture(scope="module")
def walk(clip: Clip) -> Walk:
    return Walk(clip)


@pytest.fixture(scope="module")
def passed(walk: Walk, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An engine that has passed the tag; Cf has not looked yet."""
    # What the tag tells alone.
    exact = {"filter.process.map_drift": 0.0, "filter.worn.length_sd": 0.0}
    white = with_switches(Settings.default(), exact)
    slam = Slam(walk.posted.camera, walk.posted.worn_camera, settings=white, start="target", target=TAG)
    shown = [walk.step(slam, i).diagnostics["printed_targets"] for i in range(PASSED)]
    assert shown[0] == 1
    assert not any(shown[-8:])
    path = tmp_path_factory.mktemp("passed") / "engine"
    slam.save(path)
    return path


def test_it_tells_where_cs_is(walk: Walk, passed: Path) -> None:
    ends = []
    for looks in (False, True):
        slam = Slam.load(passed)
        for i in range(PASSED, LAST):
            result = walk.step(slam, i, *([walk.view(i)] if looks else []))
            assert result.diagnostics["cf_tag_corners"] == 4 * looks
            assert result.diagnostics["cf_pixel_rows"] == 4 * looks  # none refused
            assert result.status.value == "OK"
        ends.append((result, walk.error(result, LAST - 1)))
    (alone, error_alone), (anchored, error) = ends
    assert np.linalg.norm(error[:3]) < 0.7 * np.linalg.norm(error_alone[:3])
    assert float(error @ np.linalg.solve(anchored.covariance, error)) < 16.8  # 99 % of six numbers
    assert np.trace(anchored.covariance[:3, :3]) < 0.6 * np.trace(alone.covariance[:3, :3])
    assert anchored.scale_sd < 0.6 * alone.scale_sd
    assert not len(anchored.features.pairs)  # nothing is seen by both


def test_one_that_was_moved_moves_nothing(walk: Walk, passed: Path) -> None:
    slam, alone = Slam.load(passed), Slam.load(passed)
    aside = pose(np.eye(3), [0.5, 0.0, 0.3])
    for i in range(PASSED, PASSED + 2):
        result, other = walk.step(slam, i, walk.view(i, aside)), walk.step(alone, i)
    assert result.diagnostics["cf_tag_corners"] == 4
    assert result.diagnostics["cf_pixel_rows"] == 0
    assert np.linalg.norm((pose_inverse(other.pose) @ result.pose)[:3, 3]) < 0.01


def test_a_view_that_comes_late_counts_where_it_was_taken(walk: Walk, passed: Path) -> None:
    slam, times = Slam.load(passed), walk.recording.times
    walk.step(slam, PASSED, walk.view(PASSED - 1, t=times[PASSED - 1]))  # from now on frames are kept
    for i in range(PASSED + 1, PASSED + 4):
        walk.step(slam, i)
    late = walk.view(PASSED + 1, t=times[PASSED + 1])
    result = walk.step(slam, PASSED + 4, late)
    assert result.diagnostics["cf_pixel_rows"] == 4
    assert np.linalg.norm(walk.error(result, PASSED + 4)[:3]) < 0.05


def test_only_the_mode_that_measures_pixels_of_cf_uses_it(walk: Walk) -> None:
    for mode in ("collab", "mono"):
        cameras = walk.posted.camera, walk.posted.worn_camera
        slam = Slam(*cameras, mode=mode, start="target", target=TAG)
        for i in range(3):
            result = walk.step(slam, i, walk.view(i))
        assert result.diagnostics["cf_tag_corners"] == 0


def test_from_the_command_line(walk: Walk, tmp_path: Path) -> None:
    folder, out = tmp_path / "walk", tmp_path / "out"
    with RecordingWriter(folder, walk.posted.camera, walk.posted.worn_camera) as writer:
        for i in range(6):
            writer.add(walk.recording.times[i], walk.posted.image(i), [walk.view(i)] if i > 2 else [])
    words = ["--start", "target", "--tag", f"{TAG}", "--out", str(out)]
    assert cli.main(["run", str(folder), *words]) == 0
    with (out / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["cf_tag_corners"] for row in rows] == ["0", "0", "0", "4", "4", "4"]

"""A map of one run, kept in a file, and another run with another camera that finds itself in it."""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam._core import Camera
from collabslam.cli.main import main
from collabslam.datasets import FirstFrames
from collabslam.errors import DataError, InputError, SettingsError
from collabslam.frontend.map_views import in_other_camera
from collabslam.frontend.patch import Patch, capture
from collabslam.geometry import pose_inverse, se3_log
from collabslam.runs.plan import Output
from collabslam.runs.runner import run
from collabslam.settings.modes import STARTS
from collabslam.simulation import SimulatedRecording
from collabslam.simulation.recording import WORN_CAMERA
from collabslam.slam.engine import Slam
from collabslam.slam.map.saved_map import SavedMap
from collabslam.types import Array, Image, Status

OTHER = Camera("radtan", 640, 400, (500.0, 505.0, 322.0, 199.0), (-0.04, 0.01, 0.0, 0.0005))
"""Another focal length, another resolution, another lens."""


@pytest.fixture(scope="module")
def slam(clip: Clip) -> Slam:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    for frame in clip.frames:
        slam.step(frame.t, frame.image, frame.views)
    return slam


@pytest.fixture(scope="module")
def file(slam: Slam, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "corridor.map"
    slam.saved_map().save(path)
    return path


def _other_image(recording: SimulatedRecording, pose: Array, seed: int) -> Image:
    clean = recording.renderer.render(pose, OTHER)
    noise = np.random.default_rng(seed).normal(0.0, 2.5, clean.shape)
    return np.clip(np.rint(clean + noise), 0, 255).astype(np.uint8)


def _poses(clip: Clip) -> list[Array]:
    """The way of a second run: from the middle of the first, lower, to one side, and turned."""
    shift = np.eye(4)
    shift[:3, 3] = [0.12, 0.08, 0.0]
    angle = 0.06
    shift[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return [clip.recording.truth[i] @ shift for i in range(6, 14)]


def test_it_holds_all_of_the_map(slam: Slam, file: Path) -> None:
    saved, loaded = slam.saved_map(), SavedMap.load(file)
    assert loaded.camera == slam.camera
    assert loaded.metric
    for name in ("landmarks", "covariance", "place"):
        np.testing.assert_array_equal(getattr(saved, name), getattr(loaded, name))
    assert len(loaded.landmarks) == slam.filter.map_size
    blocks = {b.id: (b.offset, b.size) for b in slam.filter.blocks if b.kind == "Feature"}
    rows = np.concatenate([np.arange(at, at + n) for at, n in blocks.values()])
    np.testing.assert_array_equal(loaded.covariance, slam.filter.covariance[np.ix_(rows, rows)])
    for some, others in zip(saved.views, loaded.views, strict=True):
        for a, b in zip(some, others, strict=True):
            for field in dataclasses.fields(Patch):
                np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))


@pytest.mark.slow
def test_another_camera_finds_itself_in_it(clip: Clip, file: Path) -> None:
    truth_of_w = pose_inverse(clip.recording.truth[0])
    second = Slam(OTHER, mode="mono", start="map", map=SavedMap.load(file))
    assert second.filter.started
    steps, values = [], []
    for k, pose in enumerate(_poses(clip)):
        step = second.step(7.0 + 0.1 * k, _other_image(clip.recording, pose, k))
        steps.append(step)
        if not step.valid:
            continue
        error = se3_log(pose_inverse(step.pose) @ truth_of_w @ pose)
        values.append(error @ np.linalg.solve(step.covariance, error))
        assert np.linalg.norm(error[:3]) < 0.1
        assert np.degrees(np.linalg.norm(error[3:])) < 1.5
    assert steps[0].status in (Status.OK, Status.LOST)
    assert [s.status for s in steps[3:]] == [Status.OK] * 5
    assert sum(s.diagnostics["relocalised"] for s in steps) == 1
    assert np.mean(values) < 12.6  # 95 % of six numbers: all poses rest on one map
    assert second.filter.soundness() > -1e-10
    # The first run's uncertainty is part of it: no better than the place of its map.
    place = SavedMap.load(file).place
    assert np.trace(steps[-1].covariance[3:, 3:]) > np.trace(place[3:, 3:])


@pytest.mark.slow
def test_it_goes_on_mapping(clip: Clip, file: Path) -> None:
    second = Slam(OTHER, mode="mono", start="map", map=SavedMap.load(file))
    born = 0
    for k, i in enumerate(range(3, 15)):
        step = second.step(0.1 * k, _other_image(clip.recording, clip.recording.truth[i], k))
        born += step.diagnostics["births_delayed"]
    assert born > 0
    again = second.saved_map()
    assert again.camera == OTHER
    assert len(again.landmarks) == second.filter.map_size


def test_where_nothing_of_it_is_seen_it_is_lost(clip: Clip, file: Path) -> None:
    second = Slam(clip.recording.camera, mode="mono", start="map", map=SavedMap.load(file))
    elsewhere = np.ascontiguousarray(clip.frames[0].image[::-1])
    for k in range(4):
        step = second.step(0.1 * k, elsewhere)
        assert step.status is Status.LOST
        assert not step.valid
    assert second.filter.map_size == len(SavedMap.load(file).landmarks)


def test_views_of_another_camera(clip: Clip) -> None:
    """The window of one camera, seen by another one, is what that one captures."""
    recording, pose = clip.recording, clip.recording.truth[0]
    uv = np.array([[200.0, 150.0], [352.3, 240.6], [500.7, 333.1]])
    clean = recording.renderer.render(pose, recording.camera).astype(np.uint8)
    there = OTHER.project(recording.camera.unproject(uv)).uv
    expected = capture(recording.renderer.render(pose, OTHER).astype(np.uint8), there, pose)
    found = in_other_camera(capture(clean, uv, pose), recording.camera, OTHER)
    for patch, wanted in zip(found, expected, strict=True):
        assert patch is not None
        np.testing.assert_allclose(patch.uv_ref, np.rint(wanted.uv_ref))
        u0, v0, u1, v1 = (int(x) for x in patch.inside + np.array([2, 2, -2, -2]))
        a = patch.pixels[v0:v1, u0:u1].astype(float).ravel()
        b = wanted.pixels[v0:v1, u0:u1].astype(float).ravel()
        assert np.corrcoef(a, b)[0, 1] > 0.9
        assert u1 - u0 > 25


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d[:-1], "cut short|altered"),
        (lambda d: d[:100], "cut short|altered"),
        (lambda d: b"", "cut short|not a map"),
        (lambda d: b"P6\n" + d, "not a map"),
        (lambda d: d[: len(d) // 2] + bytes([d[len(d) // 2] ^ 1]) + d[len(d) // 2 + 1 :], "altered"),
        (lambda d: d[:8] + struct.pack("<I", 99) + d[12:], "version 99"),
    ],
)
def test_a_bad_file(
    file: Path, tmp_path: Path, capsys: Any, change: Callable[[bytes], bytes], words: str
) -> None:
    bad = tmp_path / "bad.map"
    bad.write_bytes(change(file.read_bytes()))
    with pytest.raises(DataError, match=words) as error:
        SavedMap.load(bad)
    assert str(bad) in str(error.value)
    assert main(["run", "demo", "--map", str(bad), "--out", str(tmp_path / "out")]) == 2
    assert "error" in capsys.readouterr().err


@pytest.mark.parametrize(
    "changes",
    [
        {"landmarks": np.zeros((3, 5))},
        {"covariance": np.eye(4)},
        {"place": np.full((6, 6), np.nan)},
    ],
)
def test_parts_that_do_not_fit(slam: Slam, tmp_path: Path, changes: dict[str, Array]) -> None:
    path = tmp_path / "odd.map"
    dataclasses.replace(slam.saved_map(), **changes).save(path)
    with pytest.raises(DataError, match="not a map"):
        SavedMap.load(path)


def test_no_map_yet(clip: Clip) -> None:
    with pytest.raises(InputError, match="no map"):
        Slam(clip.recording.camera, clip.recording.worn_camera).saved_map()


def test_options_that_do_not_go_together(clip: Clip, file: Path) -> None:
    camera = clip.recording.camera
    with pytest.raises(SettingsError, match="map"):
        Slam(camera, mode="mono", start="map")
    with pytest.raises(SettingsError, match="map"):
        Slam(camera, mode="mono", start="scale-free", map=SavedMap.load(file))
    for start in STARTS:
        with pytest.raises(SettingsError, match=start):
            Slam(camera, mode="mono", start=start, map=SavedMap.load(file))


@pytest.mark.slow
def test_runs_save_it_and_start_in_it(clip: Clip, tmp_path: Path) -> None:
    path = tmp_path / "first.map"
    first = run(FirstFrames(clip.recording, 10), out=Output(save_map=path))
    second = run(FirstFrames(clip.recording, 4), mode="mono", start=SavedMap.load(path))
    assert second.summary["start"] == "map"
    assert second.summary["unit"] == first.summary["unit"]
    assert second.summary["status_final"] == "OK"
    same = second.record.poses[-1][:3, 3] - first.record.poses[3][:3, 3]
    assert np.linalg.norm(same) < 0.05


def test_the_worn_cameras_model_is_no_hindrance(clip: Clip, file: Path) -> None:
    worn = Camera("radtan", *WORN_CAMERA)
    seen = SavedMap.load(file).seen_by(worn)
    assert seen.camera == worn
    assert len(seen.landmarks) == len(seen.views) == len(SavedMap.load(file).landmarks)
    assert seen.covariance.shape == (6 * len(seen.landmarks),) * 2

"""What is shown of a run: Rerun recordings that Rerun itself reads, and the animated picture."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rerun
import rerun_cli
from helpers.clip import Clip, Short
from PIL import Image as Pictures

from collabslam import DataError, Slam
from collabslam.results import FEATURE_STATES
from collabslam.runs import runner
from collabslam.viz.animation import animate, shaded
from collabslam.viz.plot import _apart
from collabslam.viz.rerun_layout import CURVES
from collabslam.viz.rerun_log import COLOURS, SURE, UNSURE, RerunLog, by_sd

RERUN = str(Path(sys.executable).parent / "rerun")


def test_features_say_what_became_of_them(clip: Clip) -> None:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    for frame in clip.frames[:3]:
        result = slam.step(frame.t, frame.image, frame.views)
    features = result.features
    assert len(features.ids) == len(features.states) == len(features.found) == result.diagnostics["predicted"]
    assert set(features.states) <= set(FEATURE_STATES) == set(COLOURS)
    used = np.array([s == "accepted" for s in features.states])
    assert used.sum() > 15
    assert np.isfinite(features.found[used]).all()
    assert np.linalg.norm(features.found[used] - features.predicted[used], axis=1).max() < 30.0


@pytest.mark.slow
def test_rerun_reads_the_recording(clip: Clip, tmp_path: Path) -> None:
    recording, path = Short(clip, 6), tmp_path / "deep" / "view.rrd"
    with RerunLog(recording, save=path) as log:
        runner.run(recording, watch=log.frame)
    subprocess.run([RERUN, "rrd", "verify", str(path)], check=True, capture_output=True)
    listing = subprocess.run(
        [RERUN, "rrd", "stats", str(path)], check=True, capture_output=True, text=True
    ).stdout
    for entity in ("/world/cs/image/features", "/world/cs/image/ellipses", "/cf/image", "/world/map",
                   "/world/path", "/world/path_covariance", "/world/truth", "/world/overlap/cs",
                   "/world/cs/image/matches", "/cf/image/matches",
                   "/curves/status/status", "/curves/time/ms_total"):  # fmt: skip
        assert f"{entity}:" in listing
    command = [RERUN, "rrd", "print", "-vvv", str(path)]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    views = re.findall(r"\[(2D|3D|TimeSeries)\] +┆ \[(.+?)\] +┆ \[(.+?)\]", text)
    assert sorted(kind for kind, _, _ in views) == ["2D", "2D", "3D", *["TimeSeries"] * len(CURVES)]
    assert {"Cs, the robot's camera", "Cf, the worn camera"} <= {name for _, name, _ in views}
    for _, _, origin in views:
        assert f"\n/{origin}:" in listing or f"\n/{origin}/" in listing
    (followed,) = re.findall(r"\[(/world/\w+)\]", text)
    assert f"\n{followed}:" in listing


def test_ellipses_of_the_way_do_not_hide_each_other() -> None:
    positions, covariances = np.zeros((9, 3)), np.tile(0.01 * np.eye(3), (9, 1, 1))  # 3 sigma: 0.3 m
    positions[:, 2] = 0.11 * np.arange(9)
    assert _apart(np.arange(9), positions, covariances) == [8, 5, 2]
    assert _apart(np.arange(9), np.zeros((9, 3)), covariances) == [8]


def test_a_landmark_is_as_red_as_it_is_unsure() -> None:
    colours = by_sd(np.array([np.diag([1e-6, 1e-6, sd**2]) for sd in (0.5 * SURE, SURE, 0.1, UNSURE, 9.0)]))
    assert colours[0] == colours[1]
    assert colours[3] == colours[4]
    assert colours[1][1] > colours[1][0]
    assert colours[3][0] > colours[3][1]
    assert by_sd(np.empty((0, 3, 3))) == []


def test_loops_are_shown_with_the_way_that_they_correct(clip: Clip, tmp_path: Path) -> None:
    recording, path = Short(clip, 2), tmp_path / "view.rrd"
    poses = np.stack([np.eye(4), np.eye(4)])
    poses[1, :3, 3] = 1.0
    points = SimpleNamespace(points=poses[:, :3, 3], covariance=np.stack([1e-4 * np.eye(3)] * 2))
    way = SimpleNamespace(poses=poses, loops=[SimpleNamespace(first=0, second=1)], landmarks=points)
    with RerunLog(recording, save=path) as log:

        def watch(frame: Any, step: Any, engine: Any) -> None:
            shown = SimpleNamespace(landmarks=engine.landmarks, filter=engine.filter, submaps=lambda: way)
            log.frame(frame, step, shown)

        def closed(frame: Any, step: Any, engine: Any) -> None:
            step.diagnostics["loops"] = int(frame.index == 1)
            watch(frame, step, engine)

        runner.run(recording, watch=closed)
    listing = subprocess.run([RERUN, "rrd", "stats", str(path)], check=True, capture_output=True, text=True)
    for entity in ("/world/submaps", "/world/loops", "/world/whole_map"):
        assert f"{entity}:" in listing.stdout


def test_without_rerun_the_extra_is_named(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(DataError, match=r"pip install '\.\[viz\]'"):
        RerunLog(clip.recording, save=Path("x.rrd"))


def test_a_viewer_needs_a_display(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(DataError, match="--save"):
        RerunLog(clip.recording, view=True)


def test_the_viewer_is_the_environments_own(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where no search path leads to it, as in an environment that is not activated."""
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("DISPLAY", ":0")
    spawned: dict[str, Any] = {}
    monkeypatch.setattr(rerun, "spawn", lambda **options: spawned.update(options))
    with RerunLog(clip.recording, view=True):
        pass
    found = Path(spawned["executable_path"])
    assert found.is_file()
    assert found.parent == Path(rerun_cli.__file__).parent
    monkeypatch.setattr("collabslam.viz.rerun_log.find_spec", lambda name: None)
    with pytest.raises(DataError, match="without its viewer"):
        RerunLog(clip.recording, view=True)


@pytest.mark.slow
def test_the_animation_moves(clip: Clip, tmp_path: Path) -> None:
    recording = Short(clip, 12)
    results = {mode: runner.run(recording, mode=mode) for mode in ("mono", "collab")}
    animate(recording, results, tmp_path / "walk.gif")
    with Pictures.open(tmp_path / "walk.gif") as picture:
        assert picture.n_frames == 3
        first = np.asarray(picture.convert("RGB"), dtype=float)
        picture.seek(2)
        assert np.abs(np.asarray(picture.convert("RGB"), dtype=float) - first).max() > 50
        assert np.linalg.norm(first.reshape(-1, 3) - [209, 73, 91], axis=1).min() < 25  # the colour of mono
    for result in results.values():
        result.record.steps[:] = [
            SimpleNamespace(**{**vars(s), "features": None}) for s in result.record.steps
        ]
    animate(recording, results, tmp_path / "plain.gif")  # an engine of one's own need not tell its features


def test_what_is_left_out_is_darker() -> None:
    image, left_out = np.full((20, 30), 100, np.uint8), np.zeros((2, 4), np.bool_)
    left_out[1, 3] = True
    drawn = shaded(image, left_out)
    assert (drawn[8:16, 24:30] < 50).all()
    assert (drawn < 50).sum() == 8 * 6
    assert shaded(image, None) is image


def test_rerun_shows_what_is_left_out(clip: Clip, tmp_path: Path) -> None:
    mask = np.ones((480, 720), np.bool_)
    mask[:, :200] = False
    recording, path = clip.recording, tmp_path / "walk.rrd"
    slam = Slam(recording.camera, recording.worn_camera, mask=mask)
    with RerunLog(recording, view=False, save=path) as log:
        log.frame(clip.frames[0], slam.step(clip.frames[0].t, clip.frames[0].image), slam)
    assert b"left_out" in path.read_bytes()

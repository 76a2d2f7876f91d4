"""Recordings written frame by frame, and what two devices deliver: videos with lists beside them."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from helpers.clip import Clip

import collabslam
from collabslam import DataError, InputError, RecordingWriter, SettingsError, WornView, open_recording
from collabslam.datasets import attach_worn, write_recording
from collabslam.datasets.calibration import sensor_mapping
from collabslam.datasets.written_numbers import stable_quaternion
from collabslam.types import worn_cameras


@pytest.mark.slow
def test_what_is_written_in_a_loop_reads_and_runs(clip: Clip, tmp_path: Path) -> None:
    source = clip.recording
    with RecordingWriter(tmp_path / "walk", source.camera, source.worn_camera) as writer:
        for frame in clip.frames[:8]:
            views = [replace(view, bias=0.25 * view.covariance) for view in frame.views]
            writer.add(frame.t, frame.image, views, truth=source.truth[frame.index])
        assert len(writer) == 8
        assert not (tmp_path / "walk").exists()
    read = open_recording(tmp_path / "walk")
    assert read.name == "walk"
    np.testing.assert_allclose(read.times, source.times[:8], atol=1e-9)
    assert read.truth is not None
    np.testing.assert_allclose(read.truth, source.truth[:8], atol=1e-12)
    for frame in clip.frames[:8]:
        again = read.frame(frame.index)
        np.testing.assert_array_equal(again.image, frame.image)
        assert (not again.views) == (not frame.views)
        if frame.views and again.views:
            np.testing.assert_array_equal(again.views[0].image, frame.views[0].image)
            np.testing.assert_allclose(again.views[0].t_cf, frame.views[0].t_cf, atol=1e-12)
            np.testing.assert_array_equal(again.views[0].covariance, frame.views[0].covariance)
            np.testing.assert_array_equal(again.views[0].bias, 0.25 * frame.views[0].covariance)
    assert collabslam.run(tmp_path / "walk").summary["frames_ok"] == 8


def _fields(worn: WornView) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return worn.image, worn.t_cf, worn.covariance


def test_what_is_refused_leaves_the_recording_as_it_was(clip: Clip, tmp_path: Path) -> None:
    source, frame = clip.recording, clip.frames[0]
    worn = frame.views[0]
    lopsided = worn.covariance.copy()
    lopsided[0, 1] = 1e-3
    with RecordingWriter(tmp_path / "walk", source.camera, source.worn_camera) as writer:
        writer.add(1.0, frame.image)
        for message, arguments in {
            "does not follow": (1.0, frame.image),
            "finite number": (np.nan, frame.image),
            "from 0 to": (-1.0, frame.image),
            "not a .* grey image": (2.0, np.dstack([frame.image] * 3)),
            "its calibration is for": (2.0, frame.image[:100]),
            "give a list of WornView": (2.0, frame.image, worn),
            "worn image": (2.0, frame.image, [replace(worn, image=worn.image[1:])]),
            "T_CF is not a rigid": (2.0, frame.image, [replace(worn, t_cf=2.0 * worn.t_cf)]),
            "0 0 0 1": (2.0, frame.image, [replace(worn, t_cf=worn.t_cf.T)]),
            "not symmetric": (2.0, frame.image, [replace(worn, covariance=lopsided)]),
            "semidefinite": (2.0, frame.image, [replace(worn, covariance=-worn.covariance)]),
            "bias of T_CF has the shape": (2.0, frame.image, [replace(worn, bias=np.eye(3))]),
            "truth has the shape": (2.0, frame.image, [], np.full((4, 4), np.nan)),
        }.items():
            with pytest.raises(InputError, match=message):
                writer.add(*arguments)  # type: ignore[arg-type]
        writer.add(2.0, frame.image, [worn])
    with pytest.raises(InputError, match="closed"):
        writer.add(3.0, frame.image)
    assert open_recording(tmp_path / "walk").times.tolist() == [1.0, 2.0]
    with RecordingWriter(tmp_path / "alone", source.camera) as writer:
        writer.add(1.0, frame.image)
        with pytest.raises(InputError, match="no worn_camera"):
            writer.add(2.0, frame.image, [worn])
    with pytest.raises(InputError, match="load_camera"):
        RecordingWriter(tmp_path / "none", "camera.yaml")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="not a name of a folder"):
        RecordingWriter(tmp_path / "none", source.camera, name="a/b")


@pytest.mark.parametrize("who", ["", "anna"])
@pytest.mark.parametrize("body", [True, False])
def test_whether_somebody_wears_cf_is_written(clip: Clip, tmp_path: Path, body: bool, who: str) -> None:
    source, frame = clip.recording, clip.frames[0]
    worn, walk = replace(frame.views[0], who=who, body=body), tmp_path / "walk"
    cameras = {who: source.worn_camera} if who else source.worn_camera
    with RecordingWriter(walk, source.camera, cameras) as writer:
        writer.add(0.0, frame.image)
        writer.add(1.0, frame.image, [worn])
        with pytest.raises(InputError, match="all of them the same"):
            writer.add(2.0, frame.image, [replace(worn, body=not body)])
        writer.add(3.0, frame.image, [worn])
    read = open_recording(walk)
    assert [[view.body for view in read.frame(i).views] for i in range(3)] == [[], [body], [body]]
    sensor = (walk / "worn" / who if who else walk / "cam1") / "sensor.yaml"
    assert ("body" in sensor.read_text()) is not body
    sensor.write_text(yaml.safe_dump(yaml.safe_load(sensor.read_text()) | {"body": "none"}))
    with pytest.raises(DataError, match=r"'body' of .* is 'none'"):
        open_recording(walk)


def test_the_demo_shows_nobody(clip: Clip) -> None:
    views = [view for frame in clip.frames for view in frame.views]
    assert views
    assert not any(view.body for view in views)


def test_a_loop_that_breaks_off_leaves_what_it_had(clip: Clip, tmp_path: Path) -> None:
    camera, image = clip.recording.camera, clip.frames[0].image
    with pytest.raises(KeyboardInterrupt):
        _broken_off(tmp_path / "walk", clip, frames=1)
    assert len(open_recording(tmp_path / "walk")) == 1
    with pytest.raises(KeyboardInterrupt):
        _broken_off(tmp_path / "empty", clip, frames=0)
    with pytest.raises(DataError, match="no frames"), RecordingWriter(tmp_path / "empty", camera):
        pass
    with pytest.raises(DataError, match="exists already"):
        RecordingWriter(tmp_path / "walk", camera)
    with RecordingWriter(tmp_path / "walk", camera, overwrite=True) as writer:
        assert len(open_recording(tmp_path / "walk")) == 1  # there until the new one is whole
        writer.add(0.0, image)
        writer.add(1.0, image)
    assert len(open_recording(tmp_path / "walk")) == 2
    assert [p.name for p in tmp_path.iterdir()] == ["walk"]


def _broken_off(folder: Path, clip: Clip, frames: int) -> None:
    with RecordingWriter(folder, clip.recording.camera) as writer:
        for frame in clip.frames[:frames]:
            writer.add(frame.t, frame.image)
        raise KeyboardInterrupt


@pytest.fixture
def videos(clip: Clip, tmp_path: Path) -> Path:
    """Both cameras' first eight frames as two phones deliver them."""
    folder = tmp_path / "videos"
    folder.mkdir()
    source, frames = clip.recording, clip.frames[:8]
    seen = [f for f in frames if f.views]
    for name, camera, rows in (
        ("cam0", source.camera, [(f.t, f.image) for f in frames]),
        ("cam1", source.worn_camera, [(f.t + 0.004, f.views[0].image) for f in seen if f.views]),
    ):
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(sensor_mapping(camera)))
        (folder / f"{name}.csv").write_text("# stamp\n" + "".join(f"{t:.9f}\n" for t, _ in rows))
        codec = cv2.VideoWriter_fourcc(*"mp4v")
        video = cv2.VideoWriter(str(folder / f"{name}.mp4"), codec, 10.0, (camera.width, camera.height))
        for _, image in rows:
            video.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
        video.release()
    lines = [_row(f.t + 0.004, f.views[0].t_cf) + ",0.03,1.0" for f in seen if f.views]
    (folder / "t_cf.csv").write_text("\n".join(lines) + "\n")
    (folder / "truth.csv").write_text("\n".join(_row(f.t, source.truth[f.index]) for f in frames) + "\n")
    return folder


def _row(t: float, pose: np.ndarray) -> str:
    return ",".join(f"{x:.9f}" for x in (t, *pose[:3, 3], *stable_quaternion(pose[:3, :3])))


def test_two_videos_with_lists_are_a_recording(videos: Path, clip: Clip) -> None:
    read = open_recording(videos)
    assert len(read) == 8
    assert read.worn_camera == clip.recording.worn_camera
    assert read.truth is not None
    np.testing.assert_allclose(read.truth, clip.recording.truth[:8], atol=1e-6)
    for frame in clip.frames[:8]:
        again = read.frame(frame.index)
        assert np.abs(again.image.astype(int) - frame.image).mean() < 6.0
        assert (not again.views) == (not frame.views)
        if again.views and frame.views:
            assert again.views[0].t == pytest.approx(frame.t + 0.004, abs=1e-9)
            np.testing.assert_allclose(again.views[0].t_cf, frame.views[0].t_cf, atol=1e-6)
            assert np.sqrt(np.diag(again.views[0].covariance)) == pytest.approx(
                [0.03] * 3 + [np.pi / 180] * 3
            )
            assert np.abs(again.views[0].image.astype(int) - frame.views[0].image).mean() < 6.0
    assert collabslam.run(videos).summary["frames_ok"] == 7  # the first view comes with the second frame


@pytest.fixture
def persons(videos: Path) -> Path:
    """The same of two persons; Ben takes his views 1 ms before Anna, and his pose is less certain."""
    worn = videos / "worn" / "anna"
    worn.mkdir(parents=True)
    for name in ("cam1.mp4", "cam1.yaml", "cam1.csv", "t_cf.csv"):
        (videos / name).rename(worn / name)
    ben = Path(shutil.copytree(worn, worn.with_name("ben")))
    for name in ("cam1.csv", "t_cf.csv"):
        moved = _later((ben / name).read_text().replace(",0.03,1.0", ",0.06,2.0"), -0.001)
        (ben / name).write_text(moved)
    return videos


@pytest.mark.slow
def test_videos_of_several_persons_are_a_recording(persons: Path, clip: Clip, tmp_path: Path) -> None:
    read = open_recording(persons)
    assert list(worn_cameras(read)) == ["anna", "ben"]
    for frame in clip.frames[:8]:
        views = read.frame(frame.index).views
        assert [view.who for view in views] == ([] if not frame.views else ["anna", "ben"])
        for view, later, sd in zip(views, (0.004, 0.003), (0.03, 0.06), strict=True) if frame.views else ():
            assert view.t == pytest.approx(frame.t + later, abs=1e-6)
            assert np.sqrt(view.covariance[0, 0]) == pytest.approx(sd)
            np.testing.assert_allclose(view.t_cf, frame.views[0].t_cf, atol=1e-6)
    copied = open_recording(write_recording(read, tmp_path / "copied"))
    assert [view.who for view in copied.frame(1).views] == ["anna", "ben"]
    told = {of["name"]: of for of in collabslam.run(persons).summary["worn"]}
    assert told["anna"]["measured"] > 0
    assert told["ben"]["measured"] > 0


def test_faults_of_the_persons_videos_are_named(persons: Path) -> None:
    ben = persons / "worn" / "ben"
    for name, message in (
        ("t_cf.csv", r"ben.*no measured poses.*t_cf=tag"),
        ("cam1.yaml", r"ben.*no calibration"),
        ("cam1.mp4", r"ben holds no video cam1"),
    ):
        (ben / name).rename(persons / "aside")
        with pytest.raises(DataError, match=message):
            open_recording(persons)
        (persons / "aside").rename(ben / name)
    with pytest.raises(SettingsError, match=r"'clara'.*'anna', 'ben'"):
        attach_worn(open_recording(persons), "recorded:clara")
    (ben / "cam1.csv").write_text(_later((ben / "cam1.csv").read_text()))
    with pytest.raises(DataError, match="taken together"):
        open_recording(persons, topics={"t_cf": "tag:36h11:3=0.16"})
    shutil.copy(persons / "worn" / "anna" / "cam1.mp4", persons / "cam1.mp4")
    with pytest.raises(DataError, match="move the files of cam1"):
        open_recording(persons)
    (persons / "cam1.mp4").unlink()
    ben.rename(ben.with_name("ben and anna"))
    with pytest.raises(DataError, match="cannot be called 'ben and anna'"):
        open_recording(persons)


def test_faults_of_two_videos_are_named(videos: Path) -> None:
    poses = videos / "t_cf.csv"
    good = poses.read_text()
    for bad, message in (
        (good.replace(",0.03,1.0", ",0.03"), "9 columns; 10 or 29.*and two standard deviations, metres"),
        (good.replace(",0.03,1.0", ",0,1.0"), "standard deviations"),
        (good.replace(",0.03,1.0", ",0.03,nan"), "not finite"),
        (_later(good), "same clock"),
        ("", "holds no poses"),
    ):
        poses.write_text(bad)
        with pytest.raises(DataError, match=message):
            open_recording(videos)
    poses.write_text(good)
    (videos / "cam0.mp4").rename(videos / "CAM0.MP4")  # as cameras write it
    assert len(open_recording(videos)) == 8
    (videos / "cam0.csv").write_text("0.0\n")
    with pytest.raises(DataError, match="1 stamps for 8 frames"):
        open_recording(videos)
    (videos / "cam0.csv").unlink()
    (videos / "cam0.yaml").unlink()
    with pytest.raises(DataError, match="collabslam init"):
        open_recording(videos)


def _later(text: str, seconds: float = 1000.0) -> str:
    rows = [line.partition(",") for line in text.splitlines() if not line.startswith("#")]
    return "".join(f"{float(t) + seconds:.9f}{comma}{rest}\n" for t, comma, rest in rows)

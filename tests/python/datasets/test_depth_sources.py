"""Depth from what a recording has: TUM's depth images, a bag's depth topic, the second camera of a rig."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.bags import Maker
from helpers.clip import Clip, length_share

import collabslam
from collabslam import DataError, SettingsError, Source, WornSpec, open_recording
from collabslam.cli import main as cli
from collabslam.datasets.calibration import sensor_mapping
from collabslam.datasets.depth_image import depth_points
from collabslam.formats.yaml_text import load_yaml

FRAMES = 12
START = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def depths(clip: Clip) -> list[np.ndarray]:
    """What the renderer says of each frame, without noise; casting its rays takes a second each."""
    return [clip.recording.renderer.depth(t, clip.recording.camera) for t in clip.recording.truth[:FRAMES]]


def noisy(depths: list[np.ndarray], i: int) -> np.ndarray:
    depth = depths[i]
    noise = np.random.default_rng(i).normal(0.0, 1.0, depth.shape)
    return np.asarray(np.where(np.isfinite(depth), depth + noise * (0.002 + 0.002 * depth**2), 0.0))


@pytest.fixture(scope="module")
def tum(clip: Clip, depths: list[np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's first frames in TUM's layout; depth 5 ms later than colour, and none in one frame."""
    folder = tmp_path_factory.mktemp("tum") / "walk"
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    colour, depth = ["# colour"], ["# depth"]
    for frame in clip.frames[:FRAMES]:
        cv2.imwrite(str(folder / "rgb" / f"{frame.index}.png"), frame.image)
        colour.append(f"{frame.t:.6f} rgb/{frame.index}.png")
        if frame.index == 3:
            continue
        values = np.clip(5000.0 * noisy(depths, frame.index), 0, 65535).astype(np.uint16)
        cv2.imwrite(str(folder / "depth" / f"{frame.index}.png"), values)
        depth.append(f"{frame.t + 0.005:.6f} depth/{frame.index}.png")
    (folder / "rgb.txt").write_text("\n".join(colour) + "\n")
    (folder / "depth.txt").write_text("\n".join(depth) + "\n")
    (folder.parent / "camera.yaml").write_text(_yaml(clip.recording.camera))
    return folder


def _yaml(camera: collabslam.Camera) -> str:
    import yaml

    text: str = yaml.safe_dump(sensor_mapping(camera))
    assert load_yaml(text)
    return text


@pytest.mark.slow
def test_depth_images_of_tum_make_one_camera_metric(tum: Path, clip: Clip, depths: list[np.ndarray]) -> None:
    recording = open_recording(tum, camera=tum.parent / "camera.yaml")
    assert recording.frame(3).depth is None
    depth = recording.frame(2).depth
    assert depth is not None
    u, v = depth.uv.astype(int).T
    error = (depth.depth - depths[2][v, u]) / depth.sigma
    assert np.sqrt(np.mean(error**2)) < 1.2
    assert len(depth.uv) > 1000
    result = collabslam.run(recording)
    assert (result.summary["start"], result.summary["mode"]) == ("depth", "mono")
    assert result.summary["frames_ok"] == FRAMES
    assert length_share(result.record, clip.recording.truth) == pytest.approx(1.0, abs=0.02)
    words = ["run", str(tum), "--camera", str(tum.parent / "camera.yaml"), "--start", "depth"]
    assert cli.main([*words, "--out", str(tum.parent / "out")]) == 0


@pytest.mark.slow
def test_faults_of_depth_images_are_named(tum: Path) -> None:
    recording = open_recording(tum, camera=tum.parent / "camera.yaml")
    file = tum / "depth" / "5.png"
    good = file.read_bytes()
    for bad, message in (
        (good[:1000], "broken"),
        (cv2.imencode(".png", np.zeros((480, 720), np.uint8))[1].tobytes(), "not of 16 bits"),
        (cv2.imencode(".png", np.zeros((48, 72), np.uint16))[1].tobytes(), "calibrated for"),
    ):
        file.write_bytes(bad)
        with pytest.raises(DataError, match=message):
            recording.frame(5)
    file.write_bytes(good)
    with pytest.raises(SettingsError, match="--depth"):
        collabslam.run(replace(recording, depth=None), start="depth")


def test_edges_and_holes_are_no_depths() -> None:
    metres = np.full((60, 80), 2.0)
    metres[:, 40:] = 3.0
    metres[20:30, :20] = 0.0
    metres[:10] = np.nan
    metres[50:] = 100.0
    points = depth_points(metres)
    assert len(points.uv)
    u, v = points.uv.T
    assert ((v > 10) & (v < 50)).all()
    assert (np.abs(u - 39.5) > 1.0).all()
    assert not ((u < 20) & (v >= 19) & (v <= 30)).any()
    assert set(points.depth) == {2.0, 3.0}
    later = depth_points(metres, gap=-0.02)
    np.testing.assert_allclose(later.sigma - points.sigma, 0.02)


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_a_depth_topic_of_a_bag(clip: Clip, depths: list[np.ndarray], tmp_path: Path, encoding: str) -> None:
    maker = Maker(tmp_path / "walk", "ros1")
    with maker.writer:
        for frame in clip.frames[:6]:
            stamp = START + round(1e9 * frame.t)
            maker.image("/cs/image", stamp, frame.image)
            metres = noisy(depths, frame.index)
            deep = metres.astype(np.float32) if encoding == "32FC1" else (1e3 * metres).astype(np.uint16)
            maker.image("/depth/image", stamp + 4_000_000, deep, encoding)
            maker.image("/small/image", stamp, deep[::2, ::2].copy(), encoding)
            maker.image("/grey/image", stamp, frame.image)
    (tmp_path / "camera.yaml").write_text(_yaml(clip.recording.camera))
    words = ["run", str(maker.path), "--camera", str(tmp_path / "camera.yaml"), "--topics", "cs=/cs/image"]
    assert cli.main([*words, "--depth", "/depth/image", "--out", str(tmp_path / "out")]) == 0
    topics = {"cs": "/cs/image", "depth": "/depth/image"}
    recording = open_recording(maker.path, camera=tmp_path / "camera.yaml", topics=topics)
    assert recording.has_depth
    result = collabslam.run(recording)
    assert length_share(result.record, clip.recording.truth) == pytest.approx(1.0, abs=0.04)
    for topic, message in (("/small/image", "360x240"), ("/grey/image", "record the depth as 16UC1")):
        other = open_recording(maker.path, camera=tmp_path / "camera.yaml", topics={**topics, "depth": topic})
        with pytest.raises(DataError, match=message):
            other.frame(0)


@pytest.mark.slow
def test_a_rigs_second_camera_is_used_by_itself(
    clip: Clip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """KITTI's layout, rendered: two cameras side by side."""
    recording, folder = clip.recording, tmp_path / "kitti"
    lens = collabslam.Camera("pinhole", 720, 480, (620.0, 620.0, 359.5, 239.5), [])
    shift = np.eye(4)
    shift[0, 3] = 0.4
    for name in ("image_l", "image_r"):
        (folder / name).mkdir(parents=True)
    for i in range(8):
        for name, pose in (("image_l", recording.truth[i]), ("image_r", recording.truth[i] @ shift)):
            picture = recording.renderer.render(pose, lens)
            cv2.imwrite(str(folder / name / f"{i:06}.png"), np.clip(picture, 0, 255).astype(np.uint8))
    rows = [[620, 0, 359.5, x, 0, 620, 239.5, 0, 0, 0, 1, 0] for x in (0.0, -620 * 0.4)]
    (folder / "calib.txt").write_text("\n".join(" ".join(str(x) for x in row) for row in rows) + "\n")
    result = collabslam.run(folder)
    assert (result.summary["start"], result.summary["mode"]) == ("worn", "collab-tight")
    assert result.summary["frames_ok"] == 8
    assert length_share(result.record, recording.truth) == pytest.approx(1.0, abs=0.03)
    worn = Source(folder).open().frame(2).views[0]
    np.testing.assert_array_equal(worn.t_cf, shift)
    np.testing.assert_array_equal(worn.bias, worn.covariance)
    assert cli.main(["run", str(folder), "--out", str(tmp_path / "out"), "--max-frames", "4"]) == 0
    assert "second camera of the rig" in capsys.readouterr().err
    assert Source(folder, worn=WornSpec("none")).open().worn_camera is None

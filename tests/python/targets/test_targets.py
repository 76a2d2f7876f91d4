"""Printed tags and boards: where they are seen from, a metric start, an anchor later, and T_CF from them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.clip import Clip, length_share
from helpers.posted import TAG, paint, walk_past

import collabslam
from collabslam import Board, Camera, InputError, RecordingWriter, SettingsError, Slam, Tag, open_recording
from collabslam.cli import main as cli
from collabslam.datasets.wrapped import FirstFrames
from collabslam.geometry import pose, pose_inverse, rotation_exp, se3_exp, se3_log
from collabslam.slam.targets.in_map import SIZE_SD
from collabslam.targets.pose import pose_from_points
from collabslam.targets.printed import pose_between, printed_corners, sightings

CAMERA = Camera("radtan", 640, 480, (500.0, 500.0, 319.5, 239.5), [-0.05, 0.01, 0.0, 0.0])
BOARD = Board(7, 4, 0.05)
BACKGROUND = np.random.default_rng(0).integers(60, 200, (480, 640)).astype(np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize("target", [TAG, BOARD, Tag("4x4_50", 7, 0.2), Tag("25h9", 1, 0.2)], ids=str)
def test_a_printed_target_tells_the_pose(target: Tag | Board) -> None:
    rng = np.random.default_rng(1)
    distance, ranges = [], []
    for _ in range(12):
        turn = rotation_exp([0.1, rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 0.8), rng.uniform(-0.5, 0.5)])
        true = pose_inverse(pose(turn, [rng.uniform(-0.2, 0.2), 0.0, rng.uniform(0.8, 1.6)]))
        image = paint(BACKGROUND, CAMERA, true, target, np.eye(4))
        noisy = np.clip(image + rng.normal(0.0, 3.0, image.shape), 0, 255).astype(np.uint8)
        found = sightings(noisy, CAMERA, [target])
        assert [s.target for s in found] == [target]
        seen = found[0]
        error = se3_log(pose_inverse(seen.t_tc) @ true)
        distance.append(error @ np.linalg.solve(seen.covariance, error))
        ranges.append(np.linalg.norm(seen.t_tc[:3, 3]) / np.linalg.norm(true[:3, 3]) - 1.0)
    assert np.mean(distance) < 9.0  # expected 6
    assert np.abs(ranges).max() < 0.02
    assert np.abs(np.mean(ranges)) < 0.006


def test_what_is_not_there_or_twice_is_not_seen() -> None:
    assert printed_corners(BACKGROUND, [TAG, BOARD]) == {}
    left, right = (pose(np.eye(3), [x, 0.0, 1.0]) for x in (-0.2, 0.2))
    image = paint(paint(BACKGROUND, CAMERA, np.eye(4), TAG, left), CAMERA, np.eye(4), TAG, right)
    assert printed_corners(image, [TAG]) == {}
    other = paint(image, CAMERA, np.eye(4), Tag("36h11", 9, 0.16), right)
    assert list(printed_corners(other, [TAG])) == [TAG]


def test_seen_from_the_front_far_away_the_covariance_holds_both_tilts() -> None:
    tilts = []
    for k in range(8):
        true = pose(rotation_exp([0.0, 0.12, 0.0]), [0.02 * k, 0.0, 3.0])
        image = paint(BACKGROUND, CAMERA, np.eye(4), TAG, true)
        for seen in sightings(image, CAMERA, [TAG]):
            error = se3_log(pose_inverse(seen.t_tc) @ pose_inverse(true))
            tilts.append(abs(error[4]) / np.sqrt(seen.covariance[4, 4]))
    assert tilts
    assert np.mean(np.square(tilts)) < 3.0


def test_texts_of_targets() -> None:
    assert Tag.parse("36h11:3=0.16") == TAG
    assert Tag.parse(str(Tag("4x4_50", 0, 1 / 3))) == Tag("4x4_50", 0, 1 / 3)
    assert Board.parse("7x4:0.05") == BOARD
    for text, message in (("36h11", "not a tag"), ("36h12:3=0.1", "no set"), ("36h11:-3=0.1", "whole number"),
                          ("36h11:3=0", "up to 100"), ("36h11:3=nan", "up to 100")):  # fmt: skip
        with pytest.raises(InputError, match=message):
            Tag.parse(text)
    for text, message in (("7x4", "not a board"), ("2x4:0.1", "does not do"), ("7x4:-1", "up to 100")):
        with pytest.raises(InputError, match=message):
            Board.parse(text)


@pytest.fixture(scope="module")
def posted(clip: Clip) -> FirstFrames:
    return walk_past(clip, TAG, 15)


@pytest.mark.slow
@pytest.mark.parametrize("target", [TAG, BOARD], ids=str)
def test_one_camera_starts_metric_from_a_printed_target(clip: Clip, target: Tag | Board) -> None:
    walk = walk_past(clip, target, 15)
    result = collabslam.run(walk, printed=[target], mode="mono")
    assert result.summary["start"] == "target"
    assert result.summary["metric"]
    assert result.summary["options"] == {"printed": [str(target)]}
    # The first frame has the target alone, and a tag has four corners.
    coasting = [i for i, step in enumerate(result.record.steps) if step.status.value != "OK"]
    assert coasting in ([], [0])
    assert result.summary["frames_ok"] == 15 - len(coasting)
    assert result.summary["nees_position"] < 9.0  # expected 3
    assert length_share(result.record, walk.truth) == pytest.approx(1.0, abs=0.02)
    assert result.record.diagnostic("printed_targets")[0] == 1
    # How well the target's size is known limits how well the scale can be.
    assert 0.2 * SIZE_SD < result.record.steps[-1].scale_sd < 0.05


@pytest.mark.slow
def test_a_wrong_size_is_a_wrong_scale(posted: FirstFrames) -> None:
    larger = Tag(TAG.family, TAG.number, 1.5 * TAG.side)
    result = collabslam.run(posted, printed=[larger], mode="mono")
    assert length_share(result.record, posted.truth) == pytest.approx(1.5, abs=0.05)


@pytest.mark.slow
def test_a_tag_that_comes_into_view_is_an_anchor(clip: Clip, posted: FirstFrames) -> None:
    """With a scale from depths that are all too long, and uncertain enough, the tag says what is right."""
    ways, sds = [], []
    for announced in (False, True):
        slam = Slam(posted.camera, mode="mono", start="depth")
        for i in range(15):
            frame = posted.frame(i)
            if i == 0:
                uv, depth = _depths(clip)
                slam.add_depth(uv, 1.08 * depth, 0.4 * depth)
            if announced and i == 2:
                slam.add_tag("36h11", 3, 0.16)
            result = slam.step(frame.t, frame.image)
        ways.append(np.linalg.norm(result.pose[:3, 3]) / np.linalg.norm(_way(posted)))
        sds.append(result.scale_sd)
    assert ways[0] > 1.04
    assert abs(ways[1] - 1.0) < 0.02
    assert sds[1] < 0.5 * sds[0]


def _way(walk: FirstFrames) -> np.ndarray:
    return (pose_inverse(walk.truth[0]) @ walk.truth[14])[:3, 3]


def _depths(clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """True depths on a grid of the demo's first frame, from the corridor's walls."""
    recording = clip.recording
    v, u = np.mgrid[30:450:7, 30:690:7]
    uv = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    depth = recording.renderer.depth(recording.truth[0], recording.camera)[v.ravel(), u.ravel()]
    return uv, depth


def test_engines_with_targets_go_on_from_a_file(posted: FirstFrames, tmp_path: Path) -> None:
    slams = [Slam(posted.camera, mode="mono", start="target", target=TAG)]
    slams[0].add_board(7, 4, 0.05)
    for i in range(8):
        frame = posted.frame(i)
        if i == 4:
            slams[0].save(tmp_path / "engine")
            slams.append(Slam.load(tmp_path / "engine"))
        results = [slam.step(frame.t, frame.image) for slam in slams]
    np.testing.assert_array_equal(results[0].pose, results[1].pose)
    with pytest.raises(InputError, match="another size"):
        slams[1].add_tag("36h11", 3, 0.2)
    with pytest.raises(InputError, match="arbitrary unit"):
        Slam(posted.camera, mode="mono", start="scale-free").add_tag("36h11", 3, 0.16)
    with pytest.raises(SettingsError, match="--tag"):
        Slam(posted.camera, mode="mono", start="target")


def test_a_tag_in_both_images_is_a_worn_cameras_pose(clip: Clip, tmp_path: Path) -> None:
    walk = walk_past(clip, TAG, 10, alone=False)
    with RecordingWriter(tmp_path / "walk", walk.camera, walk.worn_camera) as writer:
        for i in range(10):
            frame = walk.frame(i)
            writer.add(frame.t, frame.image, frame.views, truth=walk.truth[i])
    for file in (tmp_path / "walk" / "relpose").iterdir():
        file.unlink()  # nothing else measures T_CF
    (tmp_path / "walk" / "relpose").rmdir()
    read = open_recording(tmp_path / "walk", topics={"t_cf": "tag:36h11:3=0.16"})
    distance = []
    for i in range(10):
        for worn in read.frame(i).views:
            error = se3_log(pose_inverse(worn.t_cf) @ clip.recording.true_t_cf(i))
            distance.append(error @ np.linalg.solve(worn.covariance, error))
    assert len(distance) >= 3
    assert np.mean(distance) < 12.0
    words = ["run", str(tmp_path / "walk"), "--topics", "t_cf=tag:36h11:3=0.16", "--tag", "36h11:3=0.16"]
    assert cli.main([*words, "--out", str(tmp_path / "out")]) == 0
    for text, message in (("tag:36h11", "not a tag"), ("board:7x5:0.03", "upside down"),
                          ("tag:36h11:3=0.16+sphere:1", "not understood")):  # fmt: skip
        with pytest.raises(SettingsError, match=message):
            open_recording(tmp_path / "walk", topics={"t_cf": text})


def test_pose_between_needs_a_target_in_both(clip: Clip) -> None:
    walk = walk_past(clip, TAG, 1, alone=False)
    frame = walk.frame(0)
    assert frame.views
    cameras = (walk.camera, walk.worn_camera)
    with pytest.raises(collabslam.DataError, match="No printed target"):
        pose_between(frame.image, cameras[0], BACKGROUND, CAMERA, [TAG])
    with pytest.raises(InputError, match="upside down"):
        pose_between(frame.image, cameras[0], frame.views[0].image, cameras[1], [Board(7, 5, 0.1)])  # type: ignore[arg-type]


@pytest.mark.parametrize("model", ["radtan", "fisheye"])
def test_pose_from_points_and_its_covariance(model: str) -> None:
    camera = Camera(model, 640, 480, (400.0, 400.0, 320.0, 240.0), [-0.1, 0.02, 0.0, 0.0])
    rng = np.random.Generator(np.random.PCG64(0))
    points = rng.uniform([-1, -0.8, 2.0], [1, 0.8, 4.0], (20, 3))
    true = se3_exp([0.2, -0.1, 0.3, 0.1, 0.15, -0.2])
    seen = camera.project((points - true[:3, 3]) @ true[:3, :3])
    clean, ok = seen.uv, seen.visible
    assert ok.sum() >= 10
    points, clean = points[ok], clean[ok]
    exact, _ = pose_from_points(points, clean, camera, 0.5)
    assert np.allclose(exact, true, atol=1e-7)
    distance = []
    for _ in range(60):
        noisy = clean + 0.5 * rng.standard_normal(clean.shape)
        found, covariance = pose_from_points(points, noisy, camera, 0.5, true)
        error = se3_log(pose_inverse(found) @ true)
        distance.append(error @ np.linalg.solve(covariance, error))
    assert 4.0 < np.mean(distance) < 8.0  # chi-square with six degrees of freedom


def test_pose_from_points_refuses_degenerate_input() -> None:
    line = np.c_[np.linspace(-1, 1, 6), np.zeros(6), np.full(6, 3.0)]
    uv = CAMERA.project(line).uv
    with pytest.raises(InputError, match="line"):
        pose_from_points(line, uv, CAMERA, 0.5, np.eye(4))
    with pytest.raises(InputError, match="at least four"):
        pose_from_points(line[:3], uv[:3], CAMERA, 0.5)

"""The lens is covered, somebody carries the camera elsewhere, and a tag of the map comes into view again."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.clip import Clip
from helpers.posted import Posted, paint

from collabslam import Camera, DataError, Imu, InputError, RecordingWriter, SavedMap, Slam, Tag
from collabslam.cli import main as cli
from collabslam.geometry import pose, pose_inverse, rotation_exp, se3_exp, se3_log
from collabslam.results import StepResult
from collabslam.slam.recovery.by_targets import find_by_targets
from collabslam.slam.targets.in_map import SeenTarget, check_targets
from collabslam.targets.printed import planar_solutions, printed_corners
from collabslam.types import Array, Image, Status

pytestmark = pytest.mark.slow

TAG, OTHER = Tag("36h11", 3, 0.24), Tag("36h11", 4, 0.24)
PLACES = {
    TAG: pose(rotation_exp([0.1, 0.6, 0.05]), [0.15, 0.0, 2.3]),
    OTHER: pose(rotation_exp([-0.1, 0.5, 0.1]), [-0.5, 0.1, 2.5]),
}
"""Tags beside the corridor's way, seen from where Cs starts."""
SEEN, DARK = 10, 15
"""Frames before the lens is covered, and frames in the dark: a second and a half."""
MOVED = se3_exp([0.35, -0.15, -0.3, 0.1, -0.25, 0.75])
"""Where the camera is then, seen from its start: rolled by more than its views allow for."""


@pytest.fixture(scope="module")
def walk(clip: Clip) -> Posted:
    start = clip.recording.truth[0]
    return Posted(clip.recording, [(tag, start @ at) for tag, at in PLACES.items()], alone=True)


def moved(k: int) -> Array:
    """T_WC of the k-th frame after the dark: the camera is carried on, slowly."""
    return np.asarray(MOVED @ se3_exp([0.01 * k, 0.0, 0.02 * k, 0.0, 0.005 * k, 0.0]))


def bare(walk: Posted, k: int, tags: list[Tag], t_wc: Array | None = None) -> Image:
    """The k-th image after the dark, of a wall that was papered meanwhile: nothing but tags is as it was."""
    noise = np.random.default_rng(k).normal(120.0, 2.0, (walk.camera.height, walk.camera.width))
    image = noise.astype(np.uint8)
    for tag in tags:
        image = paint(image, walk.camera, moved(k) if t_wc is None else t_wc, tag, PLACES[tag])
    return image


def furnished(walk: Posted, clip: Clip, k: int) -> Image:
    """The k-th image after the dark in the same corridor."""
    return seen_from(walk, clip, moved(k), k)


def seen_from(walk: Posted, clip: Clip, t_wc: Array, seed: int) -> Image:
    """The corridor with its tags from T_WC, where W is as Cs was first."""
    clean = clip.recording.renderer.render(clip.recording.truth[0] @ t_wc, clip.recording.camera)
    image = clip.recording._sensed(clean, 0, 1.0, np.random.default_rng(seed))
    for tag, at in PLACES.items():
        image = paint(image, walk.camera, t_wc, tag, at)
    return image


def lost(walk: Posted, tags: list[Tag]) -> Slam:
    """An engine that was started from a tag and is lost in the dark."""
    slam = Slam(walk.camera, mode="mono", start="target", target=TAG)
    for tag in tags:
        slam.announce(tag)
    for i in range(SEEN):
        frame = walk.frame(i)
        assert slam.step(frame.t, frame.image).status is not Status.LOST
    black = np.zeros_like(frame.image)
    for k in range(DARK):
        result = slam.step(frame.t + 0.1 * (k + 1), black)
    assert result.status is Status.LOST
    return slam


def go_on(slam: Slam, images: list[Image]) -> list[StepResult]:
    t = slam.filter.time
    assert t is not None
    return [slam.step(t + 0.1 * (k + 1), image) for k, image in enumerate(images)]


def distance(result: StepResult, true: Array) -> float:
    """Squared distance from the truth in standard deviations; expected 6."""
    error = se3_log(pose_inverse(result.pose) @ true)
    return float(error @ np.linalg.solve(result.covariance, error))


def test_a_tag_alone_finds_the_camera_with_a_consistent_covariance(walk: Posted) -> None:
    slam = lost(walk, [])
    wide = slam.filter.pose_covariance
    results = go_on(slam, [bare(walk, k, [TAG]) for k in range(8)])
    assert results[0].status is Status.COASTING  # four corners are not a full set
    assert results[0].diagnostics["relocalised"] == 1
    assert all(result.valid for result in results)
    assert np.mean([distance(r, moved(k)) for k, r in enumerate(results)]) < 10.0
    assert np.linalg.norm(results[-1].pose[:3, 3] - moved(7)[:3, 3]) < 0.2
    assert np.sqrt(np.diag(results[0].covariance)[:3]).max() < 0.3 < np.sqrt(np.diag(wide)[:3]).max()


def test_in_its_room_it_is_ok_at_once(walk: Posted, clip: Clip) -> None:
    slam = lost(walk, [OTHER])
    results = go_on(slam, [furnished(walk, clip, k) for k in range(4)])
    assert results[0].diagnostics["relocalised"] == 1
    assert [result.status for result in results] == [Status.OK] * 4
    assert np.mean([distance(r, moved(k)) for k, r in enumerate(results)]) < 12.0
    assert slam.filter.soundness() > -1e-10  # features of one anchor share rows of P


def test_frames_a_second_apart_are_ok_by_all_that_is_seen_from_where_a_tag_puts_the_camera(
    walk: Posted,
) -> None:
    """Their predictions are wider than the image: each time but the tag nothing of the map is found."""
    slam = Slam(walk.camera, mode="mono", start="target", target=TAG)
    slam.announce(OTHER)
    for i in range(SEEN):
        slam.step(walk.frame(i).t, walk.image(i))
    black = np.zeros_like(walk.image(0))
    dark = go_on(slam, [black] * 4)
    assert dark[-1].status is not Status.OK
    slower = [5, 1, 4, 2, 6, 3]  # forth and back, as if a slow machine took a frame now and then
    start = pose_inverse(walk.truth[0])
    for k, i in enumerate(slower):
        result = slam.step(dark[-1].t + 1.2 * (k + 1), walk.image(i))
        assert result.status is Status.OK
        assert result.diagnostics["accepted"] > 12
        assert distance(result, start @ walk.truth[i]) < 22.5


def wrong_map(walk: Posted, seed: int) -> SavedMap:
    """Of the first frames, sure of depths that are off by half, but for those of its tags."""
    slam = Slam(walk.camera, mode="mono", start="target", target=TAG)
    slam.announce(OTHER)
    for i in range(SEEN):
        slam.step(walk.frame(i).t, walk.image(i))
    known = slam.saved_map()
    others = np.setdiff1d(np.arange(len(known.landmarks)), np.concatenate([*known.targets.values()]))
    landmarks = known.landmarks.copy()
    landmarks[others, 5] *= np.exp(0.5 * np.random.default_rng(seed).standard_normal(len(others)))
    return replace(known, landmarks=landmarks, covariance=0.01 * known.covariance, place=0.01 * known.place)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_map_that_its_tags_contradict_in_each_frame_is_forgotten(
    walk: Posted, clip: Clip, seed: int
) -> None:
    """All of it that is found excludes the corners, and no frame that fails would delete a landmark."""
    slam = Slam(walk.camera, mode="mono", start="map", map=wrong_map(walk, seed))
    for k in range(12):
        t_wc = pose_inverse(walk.truth[0]) @ walk.truth[SEEN] @ se3_exp([0.005 * k, 0.0, 0.01 * k, 0, 0, 0])
        result = slam.step(0.1 * k, seen_from(walk, clip, t_wc, k))
        assert np.linalg.norm(result.pose[:3, 3] - t_wc[:3, 3]) < 0.05
    assert result.status is Status.OK
    assert result.diagnostics["accepted"] > 8


def test_a_tag_of_an_earlier_run_finds_the_camera_in_its_map(walk: Posted, tmp_path: Path) -> None:
    lost(walk, [OTHER]).saved_map().save(tmp_path / "tags.map")
    slam = Slam(walk.camera, mode="mono", start="map", map=SavedMap.load(tmp_path / "tags.map"))
    results = [slam.step(0.1 * k, bare(walk, k, [TAG, OTHER])) for k in range(8)]
    assert results[0].diagnostics["printed_targets"] == 2
    assert results[-1].valid
    found = [(k, result) for k, result in enumerate(results) if result.valid]
    assert len(found) >= 6
    assert np.mean([distance(result, moved(k)) for k, result in found]) < 12.0
    assert np.linalg.norm(results[-1].pose[:3, 3] - moved(7)[:3, 3]) < 0.2
    with pytest.raises(InputError, match="another size"):
        slam.add_tag("36h11", 3, 0.16)


def test_a_map_for_another_camera_keeps_its_tags(walk: Posted) -> None:
    known = lost(walk, []).saved_map()
    other = Camera("pinhole", 480, 320, (420.0, 420.0, 240.0, 160.0), [])
    seen = known.seen_by(other)
    kept = seen.targets[str(TAG)]
    there = kept >= 0
    assert there.any()
    assert np.allclose(seen.landmarks[kept[there]], known.landmarks[known.targets[str(TAG)][there]])
    with pytest.raises(DataError, match="36h11:3"):
        check_targets({str(TAG): np.array([0, 1, 2, len(known.landmarks)])}, len(known.landmarks), "map")


def test_without_a_tag_that_it_knows_it_stays_lost(walk: Posted) -> None:
    stranger = Tag("36h11", 9, 0.24)
    images = []
    for k in range(4):
        image = bare(walk, k, [])
        images.append(paint(image, walk.camera, moved(k), stranger, PLACES[TAG]))
    assert {r.status for r in go_on(lost(walk, []), images)} == {Status.LOST}


FRONTAL = PLACES[TAG] @ pose_inverse(pose(rotation_exp([0.0, 0.25, 0.0]), [0.1, 0.0, 3.0]))
"""T_WC from which the corners of `TAG` have two explanations, metres apart."""


def test_two_tilts_are_told_apart_by_another_tag_or_by_prediction_or_not_at_all(walk: Posted) -> None:
    alone, both = (bare(walk, 0, tags, FRONTAL) for tags in ([TAG], [TAG, OTHER]))
    corners = printed_corners(alone, [TAG])[TAG]
    chi2 = [solution[0] for solution in planar_solutions(TAG, corners, walk.camera)]
    assert len(chi2) == 2
    assert chi2[1] - chi2[0] < 9.0
    slam = lost(walk, [OTHER])
    assert go_on(slam, [alone])[0].status is Status.LOST  # a second and a half later prediction says nothing
    result = go_on(slam, [both])[0]
    assert result.valid
    assert np.linalg.norm(result.pose[:3, 3] - FRONTAL[:3, 3]) < 0.15
    seen = [s for s in slam._parts.printed.in_map() if s.target == TAG]
    found = find_by_targets(slam.filter, walk.camera, [SeenTarget(TAG, corners, seen[0].ids)])
    assert found is not None  # it has just known where it is
    assert np.linalg.norm(slam.filter.pose[:3, 3] - FRONTAL[:3, 3]) < 0.15


def test_from_the_command_line(walk: Posted, clip: Clip, tmp_path: Path) -> None:
    folder, out = tmp_path / "walk", tmp_path / "out"
    with RecordingWriter(folder, walk.camera) as writer:
        for i in range(SEEN):
            frame = walk.frame(i)
            writer.add(frame.t, frame.image)
        images = [np.zeros_like(frame.image)] * DARK + [furnished(walk, clip, k) for k in range(3)]
        for k, image in enumerate(images):
            writer.add(frame.t + 0.1 * (k + 1), image)
    words = ["--worn", "none", "--mode", "mono", "--start", "target", "--tag", f"{TAG}", "--tag", f"{OTHER}"]
    assert cli.main(["run", str(folder), *words, "--out", str(out)]) == 1  # lost in the dark
    with (out / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows[SEEN + DARK - 1 :]] == ["LOST", "OK", "OK", "OK"]
    assert [row["relocalised"] for row in rows[SEEN + DARK :]] == ["1", "0", "0"]


def test_what_was_born_where_a_tag_says_that_the_camera_is_not_goes(walk: Posted, clip: Clip) -> None:
    """A gyroscope lies that Cs has turned round: nothing is searched, and all that is seen there is new."""
    slam = Slam(walk.camera, mode="mono", start="target", target=TAG, imu=Imu())
    slam.announce(OTHER)
    for i in range(SEEN):
        slam.step(walk.frame(i).t, walk.image(i))
    t, known = walk.frame(SEEN - 1).t, slam.filter.features
    for k in range(4):
        slam.add_gyro(t + 0.05 * k, [0.0, np.pi / 0.1, 0.0])
    grid = np.meshgrid(np.arange(0.0, walk.camera.width, 4.0), np.arange(0.0, walk.camera.height, 4.0))
    slam.add_depth(np.stack(grid, axis=-1).reshape(-1, 2), 3.0, 0.1)
    t_wc = pose_inverse(walk.truth[0]) @ walk.truth[SEEN]
    result = slam.step(t + 0.1, seen_from(walk, clip, t_wc, 0))
    assert (result.diagnostics["searched"], result.diagnostics["relocalised"]) == (0, 1)
    assert np.isin(slam.filter.features, known).all()
    assert distance(result, t_wc) < 22.5

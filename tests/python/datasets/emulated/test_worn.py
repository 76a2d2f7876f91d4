"""Emulated worn cameras: which view, which relative pose, which noise, when."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from collabslam import geometry as g
from collabslam._core import Camera
from collabslam.datasets import attach_worn, open_recording, write_recording
from collabslam.datasets.emulated.pixel_noise import exposed_again, noise_sd
from collabslam.datasets.emulated.pose_noise import PoseNoise
from collabslam.datasets.emulated.view_overlap import grid_points, view_overlap
from collabslam.datasets.emulated.views import PosedViews
from collabslam.errors import DataError, SettingsError
from collabslam.types import Frame, Recording

SIZE = (32, 24)
EXACT = (0.0, 0.0, 0.0, 0.0)


class Walk:
    """A recording in memory at 10 Hz; the value of every pixel is the frame's number."""

    name, source, worn_camera, target = "walk", "memory", None, None

    def __init__(self, frames: int = 100, truth: bool = True) -> None:
        self.camera = Camera("pinhole", *SIZE, (30.0, 30.0, 15.5, 11.5), [])
        self.times = 50.0 + 0.1 * np.arange(frames)
        poses = [g.se3_exp([0.05 * k, 0.0, 0.02 * k, 0.0, 0.01 * k, 0.002 * k]) for k in range(frames)]
        self.truth = np.asarray(poses) if truth else None

    def __len__(self) -> int:
        return len(self.times)

    def image(self, i: int) -> np.ndarray:
        return np.full((SIZE[1], SIZE[0]), i % 256, np.uint8)

    def frame(self, i: int) -> Frame:
        return Frame(i, float(self.times[i]), self.image(i))


def shown(recording) -> list[int]:  # type: ignore[no-untyped-def]
    return [i for i in range(len(recording)) if recording.frame(i).views]


def test_lag_shows_the_later_image_at_its_true_pose() -> None:
    walk = Walk()
    worn = attach_worn(walk, "lag:0.7", noise=EXACT)
    view = worn.frame(10).views[0]
    assert walk.truth is not None
    assert np.median(view.image) == 17
    in_world = walk.truth[17] @ np.array([0.2, -0.1, 3.0, 1.0])
    in_c = np.linalg.inv(walk.truth[10]) @ in_world
    np.testing.assert_allclose(view.t_cf @ np.array([0.2, -0.1, 3.0, 1.0]), in_c, atol=1e-12)
    assert shown(worn) == list(range(93)), "the last frames have no view from the future"
    assert worn.worn_camera is walk.camera
    behind = attach_worn(walk, "lag:-0.7", noise=EXACT).frame(10).views[0]
    assert np.median(behind.image) == 3


def test_two_exposures_of_a_view_have_noise_of_their_own() -> None:
    random = np.random.default_rng(0)
    shape = (240, 320)
    shading = 100.0 + 40.0 * np.sin(np.arange(320) / 30.0)
    for sd, found in ((0.2, 1.0), (1.5, 1.5), (8.0, 2.0)):
        taken = np.clip(np.rint(shading + sd * random.standard_normal(shape)), 0, 255).astype(np.uint8)
        assert noise_sd(taken) == pytest.approx(found, rel=0.07)
        again = exposed_again(taken, np.random.default_rng(1))
        added = again.astype(float) - taken
        assert added.mean() == pytest.approx(0.0, abs=0.05)
        assert added.std() == pytest.approx(np.sqrt(2.0) * found, rel=0.08)
    edges = np.where(np.arange(320) // 16 % 2, 200, 50) + np.zeros(shape)
    assert noise_sd(edges.astype(np.uint8)) == 1.0


def test_what_cf_sees_is_not_what_cs_sees_later() -> None:
    """To the pixel: the filter would be told of a match that no two exposures have."""
    walk = Walk()
    worn = attach_worn(walk, "lag:0.7", seed=1)
    view, again = worn.frame(10).views[0], worn.frame(10).views[0]
    other = attach_worn(walk, "lag:0.7", seed=2).frame(10).views[0]
    difference = view.image.astype(float) - walk.image(17)
    assert difference.std() > 1.0
    np.testing.assert_array_equal(view.image, again.image)
    assert not np.array_equal(view.image, other.image)


def test_lag_skips_frames_without_a_near_image_or_truth() -> None:
    walk = Walk(30)
    walk.times[20:] += 1.0
    assert walk.truth is not None
    walk.truth[9] = np.nan
    worn = attach_worn(walk, "lag:0.5", noise=EXACT)
    expected = [i for i in range(30) if i not in (9, 4) and (i < 15 or 20 <= i < 25)]
    assert shown(worn) == expected


def test_availability_is_a_share_of_each_period_and_on_first() -> None:
    worn = attach_worn(Walk(), "lag:0.1", available=0.4, period=5.0)
    assert shown(worn) == [*range(20), *range(50, 70)]
    assert shown(attach_worn(Walk(), "lag:0.1", available=0.0)) == []
    chosen = attach_worn(Walk(), "lag:0.1", intervals=[(1.0, 1.3), (2.0, 2.2)])
    assert shown(chosen) == [10, 11, 12, 20, 21]


def test_noise_has_the_stated_covariance_on_the_right_of_the_measurement() -> None:
    walk = Walk(400)
    exact, noisy = attach_worn(walk, "lag:0.1", noise=EXACT), attach_worn(walk, "lag:0.1", seed=3)
    errors = []
    for i in range(399):
        true, measured = exact.frame(i).views[0], noisy.frame(i).views[0]
        errors.append(g.se3_log(g.pose_inverse(measured.t_cf) @ true.t_cf))
    view = noisy.frame(0).views[0]
    # Roll is about F's z, pitch about x, yaw about y.
    stated = np.array([0.03, 0.03, 0.03, *np.deg2rad([0.5, 1.0, 0.5])])
    np.testing.assert_allclose(view.covariance, np.diag(stated**2))
    np.testing.assert_allclose(np.std(errors, axis=0) / stated, 1.0, atol=0.12)
    np.testing.assert_allclose(np.mean(errors, axis=0) / stated, 0.0, atol=0.2)
    custom = attach_worn(walk, "lag:0.1", noise=PoseNoise(0.0, 1.0, 0.0, 0.0)).frame(5).views[0]
    true = exact.frame(5).views[0]
    error = g.se3_log(g.pose_inverse(custom.t_cf) @ true.t_cf)
    assert abs(error[5]) > 1e-5
    assert np.allclose(error[:5], 0.0, atol=1e-12)


def test_frames_repeat_in_any_order_and_depend_on_the_seed() -> None:
    def pose(recording, i: int) -> np.ndarray:  # type: ignore[no-untyped-def]
        view = recording.frame(i).views[0]
        return np.asarray(view.t_cf)

    a, b = attach_worn(Walk(), "lag:0.3", seed=1), attach_worn(Walk(), "lag:0.3", seed=1)
    forward = [pose(a, i) for i in range(10)]
    for i in reversed(range(10)):
        np.testing.assert_array_equal(pose(b, i), forward[i])
    other = attach_worn(Walk(), "lag:0.3", seed=2)
    assert not np.allclose(pose(other, 4), forward[4])
    masked = attach_worn(Walk(), "lag:0.3", seed=1, available=0.2)
    np.testing.assert_array_equal(pose(masked, 4), forward[4])


def test_a_bias_is_common_to_its_block() -> None:
    exact = attach_worn(Walk(), "lag:0.3", noise=EXACT)
    biased = attach_worn(Walk(), "lag:0.3", available=0.4, bias_per_block=True, seed=8)
    errors = {}
    for i in shown(biased):
        true, measured = exact.frame(i).views[0], biased.frame(i).views[0]
        errors[i] = g.se3_log(g.pose_inverse(measured.t_cf) @ true.t_cf)
    np.testing.assert_allclose([errors[i] for i in range(20)], np.tile(errors[0], (20, 1)), atol=1e-9)
    np.testing.assert_allclose(errors[69], errors[50], atol=1e-9)
    assert not np.allclose(errors[0], errors[50], atol=1e-3)


@pytest.mark.parametrize(
    ("spec", "options", "message"),
    [
        ("lagg:1", {}, "give one of: recorded, none, lag:SECONDS, rig, views:FOLDER"),
        ("lag", {}, "not understood"),
        ("lag:", {}, "not understood"),
        ("views:", {}, "not understood"),
        ("rig:2", {}, "not understood"),
        ("lag:fast", {}, "lag in seconds"),
        ("lag:0", {}, "lag in seconds"),
        ("lag:nan", {}, "lag in seconds"),
        ("lag:1", {"available": 1.5}, "share from 0 to 1"),
        ("lag:1", {"period": 0.0}, "seconds above zero"),
        ("lag:1", {"noise": (0.1, 0.1)}, "give four"),
        ("lag:1", {"noise": (-0.1, 0.1, 0.1, 0.1)}, "zero or more"),
        ("lag:1", {"intervals": [(2.0, 1.0)]}, "start < end"),
        ("lag:1", {"intervals": [(0.0, 1.0)], "available": 0.5}, "only one"),
        ("lag:1", {"seed": -1}, "seed"),
        ("recorded", {"noise": EXACT}, "takes no noise"),
        ("none", {"bias_per_block": True}, "takes no noise"),
    ],
)
def test_bad_options_are_named(spec: str, options: dict, message: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(SettingsError, match=message):
        attach_worn(Walk(), spec, **options)


def test_missing_truth_and_rig_are_named() -> None:
    with pytest.raises(DataError, match="needs true poses"):
        attach_worn(Walk(truth=False), "lag:1")
    with pytest.raises(DataError, match="needs true poses"):
        attach_worn(Walk(truth=False), "views:x")
    with pytest.raises(DataError, match="second camera"):
        attach_worn(Walk(), "rig")


def test_recorded_views_pass_through_and_can_be_masked(tmp_path: Path) -> None:
    out = write_recording(attach_worn(Walk(60), "lag:0.3", seed=4), tmp_path / "r")
    stored = open_recording(out)
    passed = attach_worn(stored, "recorded")
    a, b = stored.frame(7).views[0], passed.frame(7).views[0]
    np.testing.assert_array_equal(a.t_cf, b.t_cf)
    np.testing.assert_array_equal(a.covariance, b.covariance)
    assert passed.worn_camera is not None
    assert shown(attach_worn(stored, "recorded", available=0.2)) == [*range(10), *range(50, 57)]
    none = attach_worn(stored, "none")
    assert shown(none) == []
    assert none.worn_camera is None
    np.testing.assert_array_equal(none.image(3), stored.image(3))


def test_rig_shows_the_other_camera(tmp_path: Path) -> None:
    for folder, offset in (("image_l", 0), ("image_r", 100)):
        (tmp_path / folder).mkdir()
        for k in range(3):
            cv2.imwrite(str(tmp_path / folder / f"{k:06d}.png"), np.full((24, 32), k + offset, np.uint8))
    left = "30 0 15.5 0 0 30 11.5 0 0 0 1 0"
    (tmp_path / "calib.txt").write_text(f"{left}\n{left.replace('15.5 0', '15.5 -15', 1)}\n")
    recording = open_recording(tmp_path)
    view = attach_worn(recording, "rig", noise=EXACT).frame(2).views[0]
    assert view.image[0, 0] == 102
    np.testing.assert_allclose(view.t_cf, g.pose(np.eye(3), [0.5, 0, 0]), atol=1e-12)
    noisy = attach_worn(recording, "rig").frame(2).views[0]
    np.testing.assert_allclose(np.sqrt(np.diag(noisy.covariance)), [*[0.002] * 3, *[np.deg2rad(0.05)] * 3])


# --- views ------------------------------------------------------------------------------------

START_NS = 1_403_715_285_262_142_976
SENSOR = """
T_BS: {data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
resolution: [32, 24]
camera_model: pinhole
intrinsics: [20, 20, 15.5, 11.5]
distortion_model: none
"""


def make_still(root: Path, frames: int = 12) -> None:
    """A camera that stands at the origin."""
    stamps = [START_NS + 50_000_000 * k for k in range(frames)]
    data = root / "mav0" / "cam0" / "data"
    data.mkdir(parents=True)
    (root / "mav0" / "cam0" / "sensor.yaml").write_text(SENSOR)
    for s in stamps:
        cv2.imwrite(str(data / f"{s}.png"), np.zeros((24, 32), np.uint8))
    truth = root / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    truth.parent.mkdir()
    truth.write_text("\n".join(f"{s},0,0,0,1,0,0,0" for s in stamps))


def make_views(root: Path, recording: Recording, views: list[tuple[float, np.ndarray]]) -> PosedViews:
    """Images of the same camera: seconds after the start, T_WF."""
    paths = [root / f"view{k}.png" for k in range(len(views))]
    for k, path in enumerate(paths):
        cv2.imwrite(str(path), np.full((24, 32), k, np.uint8))
    stamps = START_NS / 10**9 + np.asarray([after for after, _ in views])
    return PosedViews(recording.camera, paths, np.asarray([pose for _, pose in views]), stamps)


def beside(x: float, yaw: float = 0.0) -> np.ndarray:
    return g.pose(g.rotation_exp([0.0, yaw, 0.0]), [x, 0.0, 0.0])


def test_views_choose_the_largest_overlap_and_take_turns(tmp_path: Path) -> None:
    make_still(tmp_path)
    recording = open_recording(tmp_path)
    given = [
        (-9.0, beside(0.5)),
        (-8.0, beside(0.8)),
        (-7.0, beside(0.01)),
        (-6.0, beside(0.5, 1.0)),
        (0.25, beside(0.45)),
    ]
    worn = attach_worn(recording, make_views(tmp_path, recording, given), noise=EXACT)
    seen = []
    for i in range(12):
        view = worn.frame(i).views[0]
        seen.append(int(view.image[0, 0]))
        np.testing.assert_allclose(view.t_cf, given[seen[-1]][1], atol=1e-6)
    assert seen == [0] * 5 + [1] * 5 + [0] * 2


def test_no_view_with_overlap_means_no_view(tmp_path: Path) -> None:
    make_still(tmp_path)
    recording = open_recording(tmp_path)
    views = make_views(tmp_path, recording, [(-1.0, beside(0.5, 1.5)), (-2.0, beside(30.0))])
    assert shown(attach_worn(recording, views)) == []


def test_views_of_another_recording_and_a_missing_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_still(tmp_path / "a")
    other = tmp_path / "other"
    (other / "images").mkdir(parents=True)
    cv2.imwrite(str(other / "images" / "0.png"), np.full((24, 32), 9, np.uint8))
    np.savetxt(other / "K.txt", [[25.0, 0, 15.5], [0, 25.0, 11.5], [0, 0, 1]])
    np.savetxt(other / "poses.txt", [beside(0.5).ravel()])
    recording = open_recording(tmp_path / "a")
    worn = attach_worn(recording, "views:../other", noise=EXACT)
    view = worn.frame(0).views[0]
    assert view.image[0, 0] == 9
    assert worn.worn_camera is not None
    assert worn.worn_camera.intrinsics[0] == 25.0
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path)
    for folder in ("nowhere", "here"):  # the working directory is not looked at
        with pytest.raises(DataError, match="lies in the recording"):
            attach_worn(recording, f"views:{folder}")
    (other / "poses.txt").unlink()
    with pytest.raises(DataError, match="not recognised"):
        attach_worn(recording, "views:../other")


def test_overlap_rewards_a_useful_baseline() -> None:
    camera = Camera("pinhole", 320, 240, (200.0, 200.0, 159.5, 119.5), [])
    points = grid_points(camera)
    share = {x: view_overlap(points, camera, beside(x)) for x in (0.0, 0.4, 5.0)}
    assert share[0.0] == 0.0, "no baseline, no parallax"
    assert share[0.4] > 0.5
    assert share[5.0] < 0.1
    assert view_overlap(points, camera, beside(0.4, np.deg2rad(40.0))) == 0.0
    assert view_overlap(points, camera, beside(0.4, np.deg2rad(-20.0))) > view_overlap(
        points, camera, beside(0.4, np.deg2rad(20.0))
    )

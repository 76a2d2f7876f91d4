"""Readers of every layout, on tiny synthetic folders."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.folders import SIZE, START_NS, make_euroc, picture, write_images

from collabslam import geometry as g
from collabslam._core import Camera
from collabslam.cli import main as cli
from collabslam.datasets import load_camera, open_recording, write_recording
from collabslam.datasets.poses import interpolate_track
from collabslam.datasets.readers import video
from collabslam.datasets.recording import ImageRecording, times_at_rate
from collabslam.errors import DataError, InputError
from collabslam.formats import video_worker
from collabslam.types import Frame, WornView


def some_pose(k: int) -> np.ndarray:
    return g.se3_exp([0.1 * k, 0.02 * k, -0.05 * k, 0.01 * k, 0.2 - 0.03 * k, 0.05 * k])


def tum_line(stamp: str, t: np.ndarray) -> str:
    w, x, y, z = g.quaternion_wxyz(t[:3, :3])
    return " ".join([stamp, *(repr(float(v)) for v in [*t[:3, 3], x, y, z, w])])


@pytest.mark.parametrize("listed", [True, False])
def test_euroc_reads_stamps_calibration_and_rig(tmp_path: Path, listed: bool) -> None:
    stamps = make_euroc(tmp_path, listed=listed)
    recording = open_recording(tmp_path)
    assert len(recording) == 4
    np.testing.assert_array_equal(recording.times, [s / 10**9 for s in stamps])
    assert recording.camera.model == "radtan"
    assert recording.camera.distortion == (-0.2, 0.07, 1e-05, 1.7e-5)
    np.testing.assert_array_equal(recording.image(2), picture(2))
    assert recording.rig is not None
    # Both cameras are turned by 90 degrees about z: 0.5 along the body's x is -0.5 along the camera's y.
    np.testing.assert_allclose(recording.rig.t_cf, g.pose(np.eye(3), [0.0, -0.5, 0.0]), atol=1e-12)
    assert sorted(recording.rig.paths) == [0, 1, 2, 3]
    assert open_recording(tmp_path / "mav0").source == recording.source


def test_euroc_truth_is_of_the_body(tmp_path: Path) -> None:
    stamps = make_euroc(tmp_path)
    assert open_recording(tmp_path).truth is None
    t_bc = g.pose(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), [0.1, 0.2, 0.3])
    state = tmp_path / "mav0" / "state_groundtruth_estimate0"
    state.mkdir()
    between = [s - 25_000_000 for s in stamps]
    rows = [
        ",".join([str(s), *(repr(float(v)) for v in [k, 0, 0, *g.quaternion_wxyz(np.eye(3)), 9, 9])])
        for k, s in enumerate(between)
    ]
    (state / "data.csv").write_text("#t,p,q\n" + "\n".join(rows))
    truth = open_recording(tmp_path).truth
    assert truth is not None
    np.testing.assert_allclose(truth[1], g.pose(np.eye(3), [1.5, 0, 0]) @ t_bc, atol=1e-5)
    assert np.all(np.isnan(truth[3])), "a frame after the trajectory has no truth"


def test_euroc_names_a_listed_image_that_is_missing(tmp_path: Path) -> None:
    stamps = make_euroc(tmp_path)
    (tmp_path / "mav0" / "cam0" / "data" / f"{stamps[1]}.png").unlink()
    with pytest.raises(DataError, match=rf"1 of 4 .*{stamps[1]}.png"):
        open_recording(tmp_path)


def test_seven_scenes_uses_the_colour_calibration_and_30_hz(tmp_path: Path) -> None:
    for k in (7, 8, 10):
        write_images(tmp_path, [f"frame-{k:06d}.color.png"], k, (640, 480))
        np.savetxt(tmp_path / f"frame-{k:06d}.pose.txt", some_pose(k) if k != 8 else np.full((4, 4), np.inf))
    (tmp_path / "camera-intrinsics.txt").write_text("585 0 320\n0 585 240\n0 0 1\n")
    recording = open_recording(tmp_path)
    assert recording.camera.intrinsics == (520.0, 520.0, 320.0, 240.0)
    np.testing.assert_allclose(recording.times, [0.0, 1 / 30, 3 / 30])
    assert recording.truth is not None
    np.testing.assert_allclose(recording.truth[2], some_pose(10), atol=1e-12)
    assert np.all(np.isnan(recording.truth[1]))


def make_posed_images(root: Path, frames: int = 5) -> None:
    write_images(root / "images", [f"{k + 3:05d}.png" for k in range(frames)])
    np.savetxt(root / "K.txt", [[30.0, 0, 15.5], [0, 31.0, 11.5], [0, 0, 1]])
    np.savetxt(root / "poses.txt", [some_pose(k).ravel() for k in range(frames)])


def test_posed_images(tmp_path: Path) -> None:
    make_posed_images(tmp_path)
    recording = open_recording(tmp_path)
    assert recording.camera.intrinsics == (30.0, 31.0, 15.5, 11.5)
    np.testing.assert_allclose(recording.times, [0, 0.1, 0.2, 0.3, 0.4])
    assert recording.truth is not None
    np.testing.assert_allclose(recording.truth[4], some_pose(4), atol=1e-12)
    (tmp_path / "images" / "00005.png").unlink()
    with pytest.raises(DataError, match="4 images but 5 poses"):
        open_recording(tmp_path)


def test_poses_that_are_not_rigid_are_refused(tmp_path: Path) -> None:
    make_posed_images(tmp_path)
    broken = [some_pose(k) for k in range(5)]
    broken[3][:3, :3] *= 2.0
    np.savetxt(tmp_path / "poses.txt", [p.ravel() for p in broken])
    with pytest.raises(DataError, match=r"Line 4 .*not a rigid pose"):
        open_recording(tmp_path)


def make_kitti(root: Path, prefix: tuple[str, str] = ("", "")) -> None:
    for folder, seed in (("image_l", 0), ("image_r", 50)):
        write_images(root / folder, [f"{k:06d}.png" for k in range(3)], seed)
    left = np.array([[30.0, 0, 15.5, 0], [0, 30.0, 11.5, 0], [0, 0, 1, 0]])
    right = left.copy()
    right[0, 3] = -30.0 * 0.5
    rows = [
        p + " ".join(repr(float(x)) for x in m.ravel()) for p, m in zip(prefix, (left, right), strict=True)
    ]
    (root / "calib.txt").write_text("\n".join(rows))
    np.savetxt(root / "poses.txt", [some_pose(k)[:3].ravel() for k in range(3)])


@pytest.mark.parametrize("prefix", [("", ""), ("P0: ", "P1: ")])
def test_kitti_right_camera_is_to_the_right(tmp_path: Path, prefix: tuple[str, str]) -> None:
    make_kitti(tmp_path, prefix)
    recording = open_recording(tmp_path)
    assert recording.rig is not None
    np.testing.assert_allclose(recording.rig.t_cf, g.pose(np.eye(3), [0.5, 0, 0]), atol=1e-12)
    np.testing.assert_allclose(recording.times, [0, 0.1, 0.2])
    assert recording.truth is not None
    np.testing.assert_allclose(recording.truth[2], some_pose(2), atol=1e-12)


def make_davison(root: Path) -> None:
    write_images(root / "frames", [f"rawoutput{k:04d}.pgm" for k in range(3)])
    write_images(root / "init", ["known_patch0.pgm", "known_patch1.pgm"], 70, (5, 5))
    (root / "cameras").mkdir()
    camera = {
        "model": "wideangle",
        "width": 32,
        "height": 24,
        "fps": 25,
        "focal_length_x": 20,
        "focal_length_y": 20,
        "principal_point_x": 16,
        "principal_point_y": 12,
        "radial_distortion_x": 9e-6,
    }
    (root / "cameras" / "mock.json").write_text(json.dumps(camera))
    state = {
        "xv": [0, 0, -0.6, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        "pxx": np.diag([4e-4, 4e-4, 9e-4, 0, 1e-4, 4e-4, 9e-4, 0, 0, 0, 0, 0, 0]).tolist(),
        "features": [{"yi": [0.1, 0.04, 0.0]}, {"yi": [-0.05, -0.09, 0.0]}],
    }
    (root / "init" / "mock.json").write_text(json.dumps(state))


def test_davison_target_lands_where_scenelib_puts_it(tmp_path: Path) -> None:
    make_davison(tmp_path)
    recording = open_recording(tmp_path)
    target = recording.target
    assert target is not None
    assert recording.truth is None
    np.testing.assert_allclose(np.diff(recording.times), 1 / 30)
    # SceneLib looks along z with x to the left and y up: u = u0 - f x / z, v = v0 - f y / z.
    camera_points = (target.points - target.t_tc[:3, 3]) @ target.t_tc[:3, :3]
    u = 16 + 20 * camera_points[:, 0] / camera_points[:, 2]
    v = 12 + 20 * camera_points[:, 1] / camera_points[:, 2]
    np.testing.assert_allclose(u, [16 - 20 * 0.1 / 0.6, 16 + 20 * 0.05 / 0.6])
    np.testing.assert_allclose(v, [12 - 20 * 0.04 / 0.6, 12 + 20 * 0.09 / 0.6])
    np.testing.assert_allclose(np.diag(target.covariance), [4e-4, 4e-4, 9e-4, 4e-4, 16e-4, 36e-4], atol=1e-15)
    np.testing.assert_array_equal(target.patches[1], picture(71, (5, 5)))
    assert recording.camera.model == "wideangle"


PLAIN = "resolution: [32, 24]\nintrinsics: [30, 30, 15.5, 11.5]\n"


def test_a_folder_needs_a_camera_and_times(tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    write_images(folder, ["a1.png", "a2.png", "a3.png"])
    camera = tmp_path / "cam.yaml"
    camera.write_text(PLAIN)
    with pytest.raises(DataError, match=r"EuRoC.*7-Scenes.*--camera.*init .*walk --board"):
        open_recording(folder)
    with pytest.raises(DataError, match="--times"):
        open_recording(folder, camera=camera)
    times = tmp_path / "times.txt"
    times.write_text("# seconds\n10.0\n10.5\n11.5\n")
    recording = open_recording(folder, camera=camera, times=times)
    np.testing.assert_array_equal(recording.times, [10.0, 10.5, 11.5])
    times.write_text(f"{START_NS}\n{START_NS + 10**9}\n{START_NS + 2 * 10**9}\n")
    recording = open_recording(folder, camera=camera, times=times)
    np.testing.assert_array_equal(recording.times[0], START_NS / 10**9)
    times.write_text("10.0\n10.5\n")
    with pytest.raises(DataError, match="2 stamps for 3 images"):
        open_recording(folder, camera=camera, times=times)
    times.write_text("10.0\n10.0\n11\n")
    recording = open_recording(folder, camera=camera, times=times)
    assert recording.left_out == 1
    np.testing.assert_array_equal(recording.times, [10.0, 11.0])
    times.write_text("1.5 rgb/a1.png\n2.5 rgb/a3.png\n")
    recording = open_recording(folder, camera=camera, times=times)
    np.testing.assert_array_equal(recording.image(1), picture(2))
    camera.write_text(PLAIN + "rate: 20\n")
    np.testing.assert_allclose(open_recording(folder, camera=camera).times, [0, 0.05, 0.1])


def test_a_folder_with_stamped_names_and_a_trajectory(tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    stamps = [START_NS + k * 100_000_000 for k in range(3)]
    write_images(folder / "images", [f"{s}.png" for s in stamps])
    camera, poses = tmp_path / "cam.yaml", tmp_path / "truth.txt"
    camera.write_text(PLAIN)
    first = START_NS / 10**9
    poses.write_text(
        "\n".join(tum_line(f"{first + 0.05 * k:.9f}", g.pose(np.eye(3), [k, 0, 0])) for k in range(4))
    )
    recording = open_recording(folder, camera=camera, poses=poses)
    assert recording.truth is not None
    np.testing.assert_allclose(recording.truth[1, 0, 3], 2.0, atol=1e-4)
    assert np.all(np.isnan(recording.truth[2]))
    poses.write_text(tum_line("5.0", np.eye(4)))
    with pytest.raises(DataError, match="share no time"):
        open_recording(folder, camera=camera, poses=poses)


def test_a_known_layout_takes_the_users_calibration_and_stamps(tmp_path: Path) -> None:
    make_posed_images(tmp_path / "r")
    camera, times = tmp_path / "cam.yaml", tmp_path / "times.txt"
    camera.write_text(PLAIN.replace("30, 30", "40, 40"))
    times.write_text("1\n2\n3\n4\n6\n")
    recording = open_recording(tmp_path / "r", camera=camera, times=times)
    assert recording.camera.intrinsics[0] == 40.0
    np.testing.assert_array_equal(recording.times, [1, 2, 3, 4, 6])


def test_missing_source_and_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="does not exist"):
        open_recording(tmp_path / "nowhere")
    (tmp_path / "walk.txt").write_text("x")
    with pytest.raises(DataError, match="is not recognised"):
        open_recording(tmp_path / "walk.txt")


def test_what_a_run_wrote_is_no_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("frames.csv", "summary.json"):
        (tmp_path / name).write_text("")
    with pytest.raises(DataError, match="is what a run wrote, not a recording"):
        open_recording(tmp_path)
    assert cli.main(["init", str(tmp_path / "none.mp4"), "--board", "7x5:0.03"]) == 2
    assert "none.mp4 does not exist" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".pgm"])
def test_broken_images_are_named(tmp_path: Path, suffix: str) -> None:
    write_images(tmp_path / "images", [f"{k}{suffix}" for k in range(3)])
    camera = tmp_path / "cam.yaml"
    camera.write_text(PLAIN + "rate: 10\n")
    victim = tmp_path / "images" / f"1{suffix}"
    recording = open_recording(tmp_path, camera=camera)
    data = victim.read_bytes()
    for damaged, said in (
        (data[: len(data) // 2], "is a .* cut short"),
        (b"", "is empty"),
        (b"not an image", "is not an image"),
    ):
        victim.write_bytes(damaged)
        with pytest.raises(DataError, match=f"1{suffix} {said}"):
            recording.frame(1)
    victim.unlink()
    with pytest.raises(DataError, match=f"1{suffix} cannot be read"):
        recording.frame(1)
    with pytest.raises(InputError, match="0 to 2"):
        recording.frame(3)


def test_colour_becomes_grey_and_sizes_are_checked(tmp_path: Path) -> None:
    grey = picture(3)
    cv2.imwrite(str(tmp_path / "0.png"), np.repeat(grey[..., None], 3, axis=2))
    camera = tmp_path / "cam.yaml"
    camera.write_text(PLAIN + "rate: 10\n")
    recording = open_recording(tmp_path, camera=camera)
    assert recording.image(0).shape == (24, 32)
    np.testing.assert_array_equal(recording.image(0), grey)
    camera.write_text(PLAIN.replace("32, 24", "64, 48") + "rate: 10\n")
    with pytest.raises(DataError, match=r"32x24.*64x48"):
        open_recording(tmp_path, camera=camera)


# --- calibration ------------------------------------------------------------------------------

KALIBR = """
cam0:
  camera_model: pinhole
  intrinsics: [30, 31, 15, 11]
  distortion_model: radtan
  distortion_coeffs: [0.1, 0.2, 0.3, 0.4]
  resolution: [32, 24]
cam1:
  camera_model: pinhole
  intrinsics: [40, 41, 15, 11]
  distortion_model: equidistant
  distortion_coeffs: [0.1, 0.2, 0.3, 0.4]
  resolution: [32, 24]
"""
ROS = """
image_width: 32
image_height: 24
camera_matrix: {rows: 3, cols: 3, data: [30, 0, 15, 0, 31, 11, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0.2, 0.3, 0.4, 0.5]}
"""


def test_kalibr_and_ros_calibrations(tmp_path: Path) -> None:
    file = tmp_path / "chain.yaml"
    file.write_text(KALIBR)
    first, second = load_camera(file), load_camera(file, "cam1")
    assert (first.model, first.intrinsics, first.distortion) == (
        "radtan",
        (30, 31, 15, 11),
        (0.1, 0.2, 0.3, 0.4),
    )
    assert (second.model, second.intrinsics) == ("fisheye", (40, 41, 15, 11))
    with pytest.raises(DataError, match=r"no camera 'cam2'.*cam0, cam1"):
        load_camera(file, "cam2")
    file.write_text(ROS)
    camera = load_camera(file)
    assert (camera.width, camera.height, camera.intrinsics) == (32, 24, (30, 31, 15, 11))
    assert camera.distortion == (0.1, 0.2, 0.3, 0.4, 0.5)


@pytest.mark.parametrize("fisheye", [False, True])
def test_opencv_file_storage(tmp_path: Path, fisheye: bool) -> None:
    file = tmp_path / "opencv.yaml"
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 32)
    storage.write("image_height", 24)
    storage.write("camera_matrix", np.array([[30.0, 0, 15], [0, 31, 11], [0, 0, 1]]))
    storage.write("distortion_coefficients", np.array([[0.1, 0.2, 0.003, 0.004]]))
    if fisheye:
        storage.write("fisheye", 1)
    storage.release()
    camera = load_camera(file)
    assert camera.model == ("fisheye" if fisheye else "radtan")
    assert (camera.width, camera.height, camera.intrinsics) == (32, 24, (30, 31, 15, 11))
    assert camera.distortion == (0.1, 0.2, 0.003, 0.004)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("intrinsics: [1, 1, 0, 0]\n", "lacks the key 'resolution'"),
        ("resolution: [32, 24]\n", "lacks the key 'intrinsics'"),
        ("resolution: [32, 24]\nintrinsics: [30, 30, 15]\n", "has 3 numbers; 4 are needed"),
        ("resolution: [32, 24]\nintrinsics: [30, x, 15, 11]\n", "not a list of numbers"),
        (PLAIN + "camera_model: omni\n", "camera model 'omni'"),
        (PLAIN + "distortion_model: rational\n", "distortion model 'rational'"),
        (PLAIN + "distortion_model: radtan\ndistortion_coeffs: [1, 2, 3]\n", "4 or 5 or 8 are needed"),
        ("camera_matrix: {data: [30, 0, 15, 0, 31, 11, 0, 0, 1]}\n", "lacks the key 'image_width'"),
        ("a: [1,\n", "not valid YAML"),
        ("just text\n", "holds no 'key: value'"),
    ],
)
def test_calibration_faults_are_named(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "cam.yaml"
    file.write_text(text)
    with pytest.raises(DataError, match=message):
        load_camera(file)


# --- stamps -----------------------------------------------------------------------------------


def test_numbers_in_names_keep_gaps() -> None:
    np.testing.assert_allclose(times_at_rate([Path("f-05.png"), Path("f-07.png")], 10.0), [0.0, 0.2])
    with pytest.raises(DataError, match="no numbers that increase"):
        times_at_rate([Path("b.png"), Path("a.png")], 10.0)


def test_interpolation_leaves_wide_gaps_open() -> None:
    stamps = np.array([0.0, 1.0, 2.0, 10.0])
    poses = np.asarray([g.pose(np.eye(3), [s, 0, 0]) for s in stamps])
    out = interpolate_track(stamps, poses, np.array([0.5, 5.0, 10.0005, 11.0]))
    np.testing.assert_allclose(out[[0, 2], 0, 3], [0.5, 10.0])
    assert np.all(np.isnan(out[[1, 3]]))


# --- the package's own layout -----------------------------------------------------------------


class Memory:
    """A recording in memory with a worn camera in some frames."""

    name, source, target = "memory walk", "memory", None

    def __init__(self, frames: int, start: float) -> None:
        rng = np.random.default_rng(5)
        self.camera = Camera("radtan", *SIZE, (30.1, 31.0, 15.5, 11.5), [-0.2, 0.07, 1e-05, 1.7e-5])
        self.worn_camera = Camera("fisheye", *SIZE, (20.0, 20.0, 16.0, 12.0), [0.1, 0.0, 1e-3, 0.0])
        self.times = start + np.cumsum(rng.uniform(0.05, 0.1, frames))
        self.truth = np.asarray([some_pose(k) for k in range(frames)])
        self.truth[1] = np.nan
        root = rng.standard_normal((frames, 6, 6))
        self.covariances = 1e-4 * root @ root.transpose(0, 2, 1)
        # Random poses, and the ones where a quaternion's sign or largest part is a tie.
        half = np.pi / np.sqrt(2.0)
        special = [np.zeros(3), [np.pi, 0, 0], [np.pi / 2, 0, 0], [half, half, 0], [0, half, -half]]
        angles = [*special, [-np.pi, 0, 0], [2 * np.pi / 3 / np.sqrt(3)] * 3]
        angles += [rng.uniform(-1.8, 1.8, 3) for _ in range(frames - len(angles))]
        self.relative = np.asarray([g.pose(g.rotation_exp(a), rng.standard_normal(3)) for a in angles])

    def __len__(self) -> int:
        return len(self.times)

    def image(self, i: int) -> np.ndarray:
        return picture(i)

    def frame(self, i: int) -> Frame:
        view = WornView(picture(1000 + i), self.relative[i], self.covariances[i])
        return Frame(i, float(self.times[i]), self.image(i), () if i % 4 == 3 else (view,))


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("start", [0.0, START_NS / 10**9])
def test_what_is_written_reads_back_the_same(tmp_path: Path, start: float) -> None:
    original = Memory(24, start)
    read = open_recording(write_recording(original, tmp_path / "a"))
    assert read.name == original.name
    np.testing.assert_allclose(read.times, original.times, atol=6e-10, rtol=0)
    if start:
        np.testing.assert_array_equal(read.times, original.times)
    assert read.camera.distortion == original.camera.distortion
    assert read.camera.intrinsics == original.camera.intrinsics
    assert read.worn_camera is not None
    assert (read.worn_camera.model, read.worn_camera.distortion) == (
        "fisheye",
        original.worn_camera.distortion,
    )
    for i in range(24):
        a, b = original.frame(i), read.frame(i)
        np.testing.assert_array_equal(a.image, b.image)
        assert (not a.views) == (not b.views)
        if a.views and b.views:
            np.testing.assert_array_equal(a.views[0].image, b.views[0].image)
            np.testing.assert_array_equal(np.tril(a.views[0].covariance), np.tril(b.views[0].covariance))
            np.testing.assert_array_equal(b.views[0].covariance, b.views[0].covariance.T)
            np.testing.assert_array_equal(a.views[0].t_cf[:3, 3], b.views[0].t_cf[:3, 3])
            np.testing.assert_allclose(a.views[0].t_cf, b.views[0].t_cf, atol=1e-12)
    assert read.truth is not None
    np.testing.assert_allclose(read.truth, original.truth, atol=1e-12)

    write_recording(read, tmp_path / "b")
    first, second = tree(tmp_path / "a"), tree(tmp_path / "b")
    assert first.keys() == second.keys()
    assert [k for k in first if first[k] != second[k]] == []


def test_frames_without_truth_stay_without(tmp_path: Path) -> None:
    original = Memory(24, 0.0)
    original.truth[5:] = np.nan
    read = open_recording(write_recording(original, tmp_path / "a"))
    assert read.truth is not None
    known = np.all(np.isfinite(read.truth), axis=(1, 2))
    assert list(np.flatnonzero(known)) == [0, 2, 3, 4]


def test_a_recording_without_a_worn_camera(tmp_path: Path) -> None:
    make_posed_images(tmp_path / "source")
    out = write_recording(open_recording(tmp_path / "source"), tmp_path / "out")
    assert not (out / "cam1").exists()
    assert not (out / "relpose").exists()
    read = open_recording(out)
    assert read.worn_camera is None
    assert not read.frame(0).views
    assert read.camera.model == "pinhole"


def test_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    out = write_recording(Memory(24, 0.0), tmp_path / "a")
    before = tree(out)
    with pytest.raises(DataError, match="exists already"):
        write_recording(Memory(24, 0.0), out)
    write_recording(Memory(24, 0.0), out, overwrite=True)
    assert tree(out) == before
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("words")
    with pytest.raises(DataError, match="not a recording"):
        write_recording(Memory(24, 0.0), tmp_path / "mine", overwrite=True)
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


def test_a_failed_write_leaves_nothing(tmp_path: Path) -> None:
    original = Memory(24, 0.0)
    original.image = lambda i: (_ for _ in ()).throw(DataError("broken"))  # type: ignore[method-assign, assignment]
    with pytest.raises(DataError, match="broken"):
        write_recording(original, tmp_path / "a")
    assert list(tmp_path.iterdir()) == []


def edit(path: Path, line: int, change) -> None:  # type: ignore[no-untyped-def]
    lines = path.read_text().splitlines()
    lines[line] = change(lines[line])
    path.write_text("\n".join(lines) + "\n")


def test_faults_of_the_own_layout_are_named(tmp_path: Path) -> None:
    out = write_recording(Memory(24, 0.0), tmp_path / "a")
    relpose, header = out / "relpose" / "data.csv", out / "recording.yaml"
    good = relpose.read_text()
    edit(relpose, 2, lambda line: line.rsplit(",", 1)[0])
    with pytest.raises(DataError, match=r"Line 3 .*28 columns"):
        open_recording(out)
    relpose.write_text(good)
    edit(relpose, 1, lambda line: ",".join([*line.split(",")[:8], "-1.0", *line.split(",")[9:]]))
    with pytest.raises(DataError, match=r"Line 2 .*not positive semidefinite"):
        open_recording(out)
    relpose.write_text(good)
    edit(relpose, 1, lambda line: ",".join([*line.split(",")[:4], "0.5,0.5,0.5,0.1", *line.split(",")[8:]]))
    with pytest.raises(DataError, match=r"Line 2 .*unit quaternion"):
        open_recording(out)
    shift = 10**12
    relpose.write_text(
        "\n".join([f"{int(r.split(',')[0]) + shift},{r.split(',', 1)[1]}" for r in good.splitlines()[1:]])
    )
    with pytest.raises(DataError, match="same clock"):
        open_recording(out)
    relpose.unlink()
    with pytest.raises(DataError, match="relpose"):
        open_recording(out)
    header.write_text("format: collabslam-recording\nversion: 9\n")
    with pytest.raises(DataError, match="version 9"):
        open_recording(out)
    header.write_text("format: other\n")
    with pytest.raises(DataError, match="not a recording"):
        open_recording(out)


def test_views_meet_frames_a_few_milliseconds_off(tmp_path: Path) -> None:
    out = write_recording(Memory(24, 100.0), tmp_path / "a")
    relpose = out / "relpose" / "data.csv"
    rows = relpose.read_text().splitlines()
    expected = open_recording(out).frame(2).views[0]
    moved = [f"{int(r.split(',')[0]) + 3_000_000},{r.split(',', 1)[1]}" for r in rows[1:]]
    relpose.write_text("\n".join(moved))
    recording = open_recording(out)
    assert [i for i in range(24) if not recording.frame(i).views] == [3, 7, 11, 15, 19, 23]
    worn = recording.frame(2).views[0]
    assert expected is not None
    np.testing.assert_array_equal(worn.t_cf, expected.t_cf)


def test_counts_must_agree() -> None:
    camera = Camera("pinhole", *SIZE, (30.0, 30.0, 15.5, 11.5), [])
    with pytest.raises(DataError, match="1 images but 2 time stamps"):
        ImageRecording("n", "s", camera, (Path("a"),), np.array([0.0, 1.0]))
    with pytest.raises(DataError, match="no frames"):
        ImageRecording("n", "s", camera, (), np.array([]))


# --- more layouts -----------------------------------------------------------------------------


def test_tum_rgbd(tmp_path: Path) -> None:
    root = tmp_path / "rgbd_dataset_freiburg3_desk"
    write_images(root / "rgb", [f"{k}.png" for k in range(3)], size=(640, 480))
    (root / "rgb.txt").write_text("# file\n" + "".join(f"{10 + 0.1 * k} rgb/{k}.png\n" for k in range(3)))
    (root / "groundtruth.txt").write_text(
        "\n".join(tum_line(f"{10 + 0.1 * k}", some_pose(k)) for k in range(2))
    )
    recording = open_recording(root)
    np.testing.assert_allclose(recording.times, [10.0, 10.1, 10.2])
    assert recording.camera.intrinsics == (535.4, 539.2, 320.1, 247.6)
    np.testing.assert_allclose(recording.truth[1], some_pose(1), atol=1e-9)
    assert np.isnan(recording.truth[2]).all()
    other = root.rename(tmp_path / "desk")
    with pytest.raises(DataError, match="--camera"):
        open_recording(other)
    (other / "rgb.txt").write_text("10.0\n")
    with pytest.raises(DataError, match="two columns"):
        open_recording(other)


@pytest.mark.parametrize(("left", "right", "first"), [("image_0", "image_1", 0), ("image_2", "image_3", 2)])
def test_kitti_odometry(tmp_path: Path, left: str, right: str, first: int) -> None:
    sequence = tmp_path / "dataset" / "sequences" / "07"
    for name in (left, right):
        write_images(sequence / name, [f"{k:06d}.png" for k in range(3)])
    k = np.array([[30.0, 0, 15.5, 0], [0, 30.0, 11.5, 0], [0, 0, 1.0, 0]])
    offsets = [0.0, -0.54, 0.06, -0.48]
    lines = []
    for n, x in enumerate(offsets):
        p = k.copy()
        p[:, 3] = k[:, :3] @ [x, 0, 0]
        lines.append(f"P{n}: " + " ".join(map(str, p.ravel())))
    (sequence / "calib.txt").write_text("\n".join([*lines, "Tr: " + " ".join(["0"] * 12)]))
    (sequence / "times.txt").write_text("0.0\n0.1\n0.25\n")
    poses = tmp_path / "dataset" / "poses"
    poses.mkdir()
    np.savetxt(poses / "07.txt", [some_pose(n)[:3].ravel() for n in range(3)])
    recording = open_recording(sequence)
    np.testing.assert_allclose(recording.times, [0.0, 0.1, 0.25])
    np.testing.assert_allclose(recording.rig.t_cf[:3, 3], [0.54, 0, 0], atol=1e-12)
    expected = some_pose(2) @ g.pose(np.eye(3), [-offsets[first], 0, 0])
    np.testing.assert_allclose(recording.truth[2], expected, atol=1e-9)


def test_frames_of_a_video_are_the_same_in_any_order_and_are_sought(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video_worker, "limit_time", lambda _: None)  # this process is no helper
    path = tmp_path / "walk.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 20.0, (32, 24))
    for k in range(300):
        writer.write(np.full((24, 32, 3), 20 + 7 * k % 200, np.uint8))
    writer.release()
    film = video.Video(path)
    expected = [film.read(k) for k in range(300)]
    for k in (290, 120, 250, 249, 0, 299, 5):
        np.testing.assert_array_equal(film.read(k), expected[k])
    asked = video_worker._Film(str(path))
    asked.answer(video_worker.STAMPS)
    asked._seek(200)
    assert 100 < asked._next <= 200
    shape = video_worker.SHAPE.size
    for k in (210, 205, 299):  # as they are after a jump
        asked._seek(k)
        assert asked._frame(k)[shape:] == expected[k].tobytes()


def test_video(tmp_path: Path) -> None:
    path = tmp_path / "walk.avi"
    frames = [np.full((24, 32, 3), 20 + 40 * k, np.uint8) for k in range(5)]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 20.0, SIZE)
    for frame in frames:
        writer.write(frame)
    writer.release()
    camera, times = tmp_path / "cam.yaml", tmp_path / "times.txt"
    camera.write_text(PLAIN)
    with pytest.raises(DataError, match=f"--camera FILE. 'collabslam init {path} --board"):
        open_recording(path)
    recording = open_recording(path, camera=camera)
    np.testing.assert_allclose(np.diff(recording.times), 0.05)
    for k in (0, 1, 4, 2, 0):
        np.testing.assert_allclose(recording.image(k), frames[k][..., 0], atol=3)
    times.write_text("1\n2\n3\n4\n9\n")
    assert open_recording(path, camera=camera, times=times).times[-1] == 9.0
    times.write_text("1\n2\n")
    with pytest.raises(DataError, match="2 stamps for 5 frames"):
        open_recording(path, camera=camera, times=times)
    camera.write_text(PLAIN.replace("32, 24", "64, 48"))
    with pytest.raises(DataError, match="64x48"):
        open_recording(path, camera=camera)
    path.write_bytes(b"nothing")
    with pytest.raises(DataError, match="cannot be decoded"):
        open_recording(path, camera=camera)

"""ROS 1 and ROS 2 bags, written here and read as recordings and as arrays."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from helpers.bags import FRAMES, HEIGHT, IMAGES, KINDS, START, STEP, WIDTH, Maker
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from collabslam import geometry as g
from collabslam.cli import main as cli
from collabslam.datasets import open_recording
from collabslam.datasets.deep_range import Range
from collabslam.datasets.ros import bounded, messages
from collabslam.datasets.ros.bag import Bag
from collabslam.errors import DataError, SettingsError

POSE_COV = np.diag([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]) ** 2


def t_cf(t: float) -> np.ndarray:
    return g.se3_exp([0.5 + 0.1 * t, 0.0, 0.2, 0.0, 0.3, 0.1 * t])


def two_cameras(path: Path, kind: str) -> Path:
    """Images of Cs and compressed ones of Cf, both with CameraInfo, T_CF at other instants, and a tf."""
    maker = Maker(path, kind)
    with maker.writer:
        for k in range(-1, FRAMES + 1):
            t = START + k * STEP + STEP // 2
            tangent = g.tangent_to_fixed(t_cf((t - START) / 1e9), POSE_COV)
            maker.pose_cov("/relpose", t, t_cf((t - START) / 1e9), tangent)
        for k in range(FRAMES):
            t = START + k * STEP
            maker.image("/cs/image_raw", t, IMAGES[k])
            maker.camera("/cs/camera_info", t)
            maker.camera("/cf/camera_info", t, 28.0)
            if k % 2 == 0:
                data = cv2.imencode(".png", 255 - IMAGES[k])[1].ravel()
                maker.write("/cf/image_raw/compressed", "sensor_msgs/msg/CompressedImage", t,
                            maker.header(t + 2_000_000), "png", data)  # fmt: skip
            maker.link("/tf", t, "map", "cam", g.se3_exp([0.1 * k, 0, 0, 0, 0, 0]))
        maker.topic("/nothing", "sensor_msgs/msg/Image")
    return maker.path


TOPICS = {"cs": "/cs/image_raw", "cf": "/cf/image_raw/compressed", "truth": "tf:map:cam"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_is_a_recording(tmp_path: Path, kind: str) -> None:
    recording = open_recording(two_cameras(tmp_path / "walk", kind), topics=TOPICS)
    np.testing.assert_allclose(recording.times, START / 1e9 + 0.1 * np.arange(FRAMES), atol=1e-6)
    assert recording.camera.intrinsics == (30.0, 30.0, 15.5, 11.5)
    assert recording.camera.model == "radtan"
    assert recording.worn_camera.intrinsics[0] == 28.0
    for k in (0, 1, 4, 3, 5, 0):  # in any order
        frame = recording.frame(k)
        np.testing.assert_array_equal(frame.image, IMAGES[k])
        assert (bool(frame.views)) == (k % 2 == 0)
        if frame.views:
            np.testing.assert_array_equal(frame.views[0].image, 255 - IMAGES[k])
            assert frame.views[0].t == pytest.approx(frame.t + 0.002, abs=1e-6)
            np.testing.assert_allclose(frame.views[0].t_cf, t_cf(0.1 * k + 0.002), atol=1e-4)
            np.testing.assert_allclose(frame.views[0].covariance, POSE_COV, atol=1e-4)
    np.testing.assert_allclose(recording.truth[3], g.se3_exp([0.3, 0, 0, 0, 0, 0]), atol=1e-6)


def test_tf_can_give_the_worn_cameras_pose(tmp_path: Path) -> None:
    """tf carries no covariance, so its standard deviations are given beside its two frames."""
    path = two_cameras(tmp_path / "walk", "mcap")
    recording = open_recording(path, topics={**TOPICS, "t_cf": "tf:map:cam:0.03:1.5"})
    worn = recording.frame(4).views[0]
    np.testing.assert_allclose(worn.t_cf, g.se3_exp([0.402, 0, 0, 0, 0, 0]), atol=1e-6)
    deviations = [0.03] * 3 + [np.deg2rad(1.5)] * 3
    np.testing.assert_allclose(worn.covariance, np.diag(deviations) ** 2, atol=1e-12)
    with pytest.raises(SettingsError, match="give tf:CS:CF:METRES:DEGREES"):
        open_recording(path, topics={**TOPICS, "t_cf": "tf:map:cam"})
    with pytest.raises(SettingsError, match="must be above zero"):
        open_recording(path, topics={**TOPICS, "t_cf": "tf:map:cam:0.03:0"})


def camchain(path: Path, shift: float) -> Path:
    """A Kalibr camchain of the two cameras; cam1 is 0.2 m to the right of cam0, turned by 0.1 rad."""
    t_c1_c0 = np.linalg.inv(g.se3_exp([0.2, 0, 0, 0, 0.1, 0]))
    lens = {"camera_model": "pinhole", "distortion_model": "radtan", "distortion_coeffs": [0.0] * 4,
            "resolution": [WIDTH, HEIGHT], "timeshift_cam_imu": 0.001}  # fmt: skip
    second = {**lens, "intrinsics": [27, 27, 15.5, 11.5], "T_cn_cnm1": t_c1_c0.tolist()}
    chain = {"cam0": {**lens, "intrinsics": [30, 30, 15.5, 11.5]},
             "cam1": {**second, "timeshift_cam_imu": 0.001 + shift}}  # fmt: skip
    path.write_text(yaml.safe_dump(chain), encoding="utf-8")
    return path


def test_a_kalibr_camchain_makes_a_rig_of_two_topics(tmp_path: Path) -> None:
    path = two_cameras(tmp_path / "walk", "sqlite3")
    topics = {**TOPICS, "t_cf": "rig"}
    recording = open_recording(path, camera=camchain(tmp_path / "chain.yaml", -0.002), topics=topics)
    assert recording.camera.intrinsics[0] == 30.0
    assert recording.worn_camera.intrinsics[0] == 27.0
    worn = recording.frame(2).views[0]
    np.testing.assert_allclose(worn.t_cf, g.se3_exp([0.2, 0, 0, 0, 0.1, 0]), atol=1e-12)
    assert worn.covariance[0, 0] == 0.002**2
    # Cf's stamps are 2 ms late; a clock that is 50 ms off puts its views between frames, one of 5 s nowhere.
    between = open_recording(path, camera=camchain(tmp_path / "chain.yaml", 0.05), topics=topics)
    worn = between.frame(3).views[0]
    assert worn.t == pytest.approx(between.times[2] + 0.052, abs=1e-6)
    assert not between.frame(2).views
    with pytest.raises(DataError, match="same clock"):
        open_recording(path, camera=camchain(tmp_path / "chain.yaml", 5.0), topics=topics)
    with pytest.raises(DataError, match="needs the Kalibr camchain"):
        open_recording(path, topics=topics)


def test_info_lists_the_topics(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = two_cameras(tmp_path / "walk", "mcap")
    assert cli.main(["info", str(path)]) == 2  # two image topics: which is which?
    shown = capsys.readouterr()
    assert "/cs/image_raw" in shown.out
    assert "sensor_msgs/msg/CompressedImage" in shown.out
    assert "--topics cs=TOPIC" in shown.err
    assert cli.main(["info", str(path), "--topics", "cs=/cs/image_raw"]) == 0
    assert "32x24 radtan" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        cli.main(["info", str(path), "--topics", "cs"])


@pytest.mark.parametrize(
    ("topics", "words"),
    [
        ({"cs": "/nothing"}, "topic /nothing .* is empty"),
        ({"cs": "/none"}, "has no topic /none; its topics are"),
        ({"cs": "/tf"}, "is a tf2_msgs"),
        ({"left": "/cs/image_raw"}, "role 'left'"),
        ({"cs": "/cs/image_raw", "truth": "tf:map:moon"}, "does not link map and moon; it links map > cam"),
        ({"cs": "/cs/image_raw", "cf": "/cs/image_raw", "t_cf": "/tf"}, "PoseWithCovarianceStamped"),
        ({"cs": "/cs/image_raw", "cs_info": "/tf"}, "CameraInfo is needed"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, topics: dict[str, str], words: str) -> None:
    path = two_cameras(tmp_path / "walk", "sqlite3")
    with pytest.raises(DataError, match=words):
        open_recording(path, topics=topics)


def test_bags_without_images_or_calibration_or_that_are_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    maker = Maker(tmp_path / "poses", "sqlite3")
    with maker.writer:
        maker.pose_cov("/relpose", START, np.eye(4), POSE_COV)
    assert cli.main(["run", str(maker.path)]) == 2
    error = capsys.readouterr().err
    assert "has no images; its topics are: /relpose" in error
    assert error.count("\n") == 1
    maker = Maker(tmp_path / "raw", "mcap")
    with maker.writer:
        maker.image("/image", START, IMAGES[0])
        maker.camera("/camera_info", START, 0.0)
    with pytest.raises(DataError, match="not calibrated"):
        open_recording(maker.path)
    camera = tmp_path / "cam.yaml"
    camera.write_text("resolution: [32, 24]\nintrinsics: [30, 30, 15.5, 11.5]\n")
    assert len(open_recording(maker.path, camera=camera)) == 1
    camera.write_text("resolution: [64, 48]\nintrinsics: [30, 30, 15.5, 11.5]\n")
    with pytest.raises(DataError, match=r"32x24 .* 64x48; give the calibration"):
        open_recording(maker.path, camera=camera)
    (tmp_path / "broken.bag").write_bytes(b"no bag")
    with pytest.raises(DataError, match="cannot be read"):
        open_recording(tmp_path / "broken.bag")


def test_the_clocks_must_agree(tmp_path: Path) -> None:
    maker = Maker(tmp_path / "late", "sqlite3")
    with maker.writer:
        maker.image("/cs/image", START, IMAGES[0])
        maker.image("/cf/image", START + STEP, IMAGES[1])
        maker.camera("/cs/camera_info", START)
        maker.camera("/cf/camera_info", START)
        maker.pose_cov("/relpose", START, np.eye(4), POSE_COV)
    with pytest.raises(DataError, match="put all three on the same clock"):
        open_recording(maker.path, topics={"cs": "/cs/image", "cf": "/cf/image"})
    with pytest.raises(DataError, match="share no time"):
        open_recording(
            maker.path, topics={"cs": "/cf/image", "truth": "/relpose", "cs_info": "/cs/camera_info"}
        )


@pytest.mark.parametrize("kind", KINDS)
def test_scans_and_inertial_samples_are_arrays(tmp_path: Path, kind: str) -> None:
    maker = Maker(tmp_path / "sensors", kind)
    vector = "geometry_msgs/msg/Vector3"
    with maker.writer:
        for k in range(3):
            t = START + k * STEP
            ranges, limits = np.array([0.1, 2.0 + k, 25.0], np.float32), (0.3, 20.0)
            maker.write("/scan", "sensor_msgs/msg/LaserScan", t, maker.header(t, "laser"),
                        -0.1, 0.1, 0.1, 0.0, 0.1, *limits, ranges, np.empty(0, np.float32))  # fmt: skip
            unknown = np.zeros(9)
            unknown[0] = -1.0 if k == 2 else 0.0
            maker.write("/imu", "sensor_msgs/msg/Imu", t, maker.header(t, "imu"),
                        maker.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0), unknown,
                        maker.make(vector, 0.1, 0.2, 0.3), np.zeros(9),
                        maker.make(vector, 0.0, 0.0, 9.81), np.zeros(9))  # fmt: skip
    with Bag(maker.path) as bag:
        scans, imu = bag.scans("/scan"), bag.imu("/imu")
    np.testing.assert_allclose(scans.angles, [-0.1, 0.0, 0.1], atol=1e-6)
    np.testing.assert_allclose(scans.ranges[:, 1], [2.0, 3.0, 4.0])
    assert np.isnan(scans.ranges[:, 0]).all()
    assert (scans.ranges[:, 2] == np.inf).all()  # nothing up to the limit, which is not silence
    assert scans.range_max == 20.0
    assert scans.frame == "laser"
    np.testing.assert_allclose(imu.angular_velocity[1], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(imu.acceleration[:, 2], 9.81)
    assert np.isnan(imu.orientation).all(axis=1).tolist() == [False, False, True]
    np.testing.assert_allclose(imu.times, START / 1e9 + 0.1 * np.arange(3), atol=1e-6)


ENCODINGS = {
    "bgr8": lambda grey: np.repeat(grey[..., None], 3, axis=2),
    "rgba8": lambda grey: np.dstack([grey, grey, grey, np.full_like(grey, 255)]),
    "mono16": lambda grey: grey.astype("<u2") * 256 + 7,
    "8UC1": lambda grey: grey,
}


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_image_encodings(encoding: str) -> None:
    grey = IMAGES[0]
    pixels = np.ascontiguousarray(ENCODINGS[encoding](grey))
    rows = pixels.reshape(HEIGHT, -1).view(np.uint8)
    padded = np.pad(rows, ((0, 0), (0, 5)))
    message = SimpleNamespace(height=HEIGHT, width=WIDTH, encoding=encoding, step=padded.shape[1],
                              is_bigendian=0, data=padded.ravel())  # fmt: skip
    np.testing.assert_allclose(messages.image_of(message, "x"), grey, atol=1)
    message.data = message.data[: padded.size // 2]
    with pytest.raises(DataError, match="it is broken"):
        messages.image_of(message, "x")
    message.encoding = "yuv422"
    with pytest.raises(DataError, match="yuv422"):
        messages.image_of(message, "x")


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_patterns_know_red_from_blue(pattern: str) -> None:
    level = {"r": 200, "g": 100, "b": 20}
    tile = np.array(
        [[level[pattern[0]], level[pattern[1]]], [level[pattern[2]], level[pattern[3]]]], np.uint8
    )
    data = np.tile(tile, (HEIGHT // 2, WIDTH // 2))
    message = SimpleNamespace(height=HEIGHT, width=WIDTH, encoding=f"bayer_{pattern}8", step=WIDTH,
                              is_bigendian=0, data=data.ravel())  # fmt: skip
    grey = messages.image_of(message, "x")[4:-4, 4:-4]
    np.testing.assert_allclose(grey, 0.299 * 200 + 0.587 * 100 + 0.114 * 20, atol=2)


def test_camera_info_models() -> None:
    roi = SimpleNamespace(width=0, height=0, x_offset=0, y_offset=0)
    fields = {"k": np.array([30.0, 0, 15, 0, 31, 11, 0, 0, 1]), "width": 32, "height": 24, "roi": roi,
              "binning_x": 0, "binning_y": 0}  # fmt: skip

    def camera(model: str, d: list[float], **more: object) -> Any:
        return messages.camera_of(
            SimpleNamespace(**{**fields, "distortion_model": model, "d": np.array(d), **more}), "x"
        )

    assert camera("plumb_bob", [0, 0, 0, 0, 0]).model == "pinhole"
    assert camera("", []).model == "pinhole"
    assert camera("rational_polynomial", [0.1, 0, 0, 0, 0.2, 0, 0, 0]).distortion == (0.1, 0, 0, 0, 0.2)
    assert camera("equidistant", [0.1, 0, 0, 0]).model == "fisheye"
    assert camera("rational_polynomial", [0.1, 0, 0, 0, 0.2, 0.3, 0, 0]).distortion[5] == 0.3
    assert camera("plumb_bob", [0.1, 0, 0, 0, 0.2, 0, 0, 0]).distortion == (0.1, 0, 0, 0, 0.2)
    whole = SimpleNamespace(width=32, height=24, x_offset=0, y_offset=0)
    assert camera("plumb_bob", [0.1, 0, 0, 0], roi=whole).width == 32
    for d, more in (([0.1, 0, 0, 0, 0.2, 0.3, 0, 0, 0.1, 0, 0, 0], {}), ([0.0] * 5, {"binning_x": 2})):
        with pytest.raises(DataError):
            camera("rational_polynomial", d, **more)


def test_bad_sources_give_one_sentence_and_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "unknown").mkdir()
    (tmp_path / "unknown" / "notes.txt").write_text("no recording")
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "0.png"), IMAGES[0])
    camera, broken = tmp_path / "cam.yaml", tmp_path / "broken.yaml"
    camera.write_text("resolution: [640, 480]\nintrinsics: [500, 500, 320, 240]\nrate: 10\n")
    broken.write_text("resolution: [32, 24]\nrate: 10\n")
    maker = Maker(tmp_path / "poses", "mcap")
    with maker.writer:
        maker.pose_cov("/relpose", START, np.eye(4), POSE_COV)
    cases = [
        (["unknown"], "is not recognised; the known ones are"),
        (["nowhere"], "does not exist; give"),
        (["images", "--camera", str(camera)], "is 32x24 but its camera is calibrated for 640x480; give"),
        (["images", "--camera", str(broken)], "lacks the key 'intrinsics'; add it"),
        (["poses"], "has no images; its topics are"),
    ]
    for command in ("run", "info", "check-calib"):
        for (source, *rest), words in cases:
            assert cli.main([command, str(tmp_path / source), *rest]) == 2
            error = capsys.readouterr().err
            assert words in error
            assert error.startswith("collabslam: error: ")
            assert error.count("\n") == 1


def folder_of_images(folder: Path, distortion: str, coefficients: str) -> Path:
    """A folder of images with a camera of a model."""
    folder.mkdir()
    for k, image in enumerate(IMAGES):
        cv2.imwrite(str(folder / f"{k}.png"), image)
    (folder.parent / "camera.yaml").write_text(
        f"resolution: [{WIDTH}, {HEIGHT}]\nintrinsics: [30, 30, 15.5, 11.5]\nrate: 10\n"
        f"distortion_model: {distortion}\ndistortion_coefficients: {coefficients}\n"
    )
    return folder


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize(
    ("model", "coefficients"),
    [("none", "[]"), ("radtan", "[-0.1, 0.02, 0.001, 0.0]"), ("equidistant", "[0.1, 0.0, 0.0, 0.01]")],
)
def test_a_camera_of_any_model_is_recorded(
    tmp_path: Path, storage: str, model: str, coefficients: str
) -> None:
    folder = folder_of_images(tmp_path / "walk", model, coefficients)
    camera, bag = tmp_path / "camera.yaml", tmp_path / "bag"
    command = ["record", str(folder), str(bag), "--camera", str(camera), "--bag", storage]
    assert cli.main(command) == 0
    written = open_recording(bag, topics={"cs": "/cs/image_raw"})
    given = open_recording(folder, camera=camera)
    uv = np.array([[3.0, 5.0], [20.0, 17.0]])
    np.testing.assert_allclose(written.camera.unproject(uv), given.camera.unproject(uv), atol=1e-12)
    np.testing.assert_array_equal(written.image(4), IMAGES[4])
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


@pytest.mark.parametrize("fault", ["model", "image"])
def test_a_failed_bag_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str], fault: str) -> None:
    distortion = ("equidistant", "[0, 0, 0, 0]") if fault == "image" else ("wideangle", "[0.01]")
    folder = folder_of_images(tmp_path / "walk", *distortion)
    if fault == "image":
        (folder / "3.png").write_bytes(b"broken")
    command = ["record", str(folder), str(tmp_path / "bag"), "--camera", str(tmp_path / "camera.yaml")]
    assert cli.main([*command, "--bag", "mcap"]) == 2
    assert ("has no name in ROS" if fault == "model" else "3.png") in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["camera.yaml", "walk"]


@pytest.mark.parametrize("compression", ["file", "message"])
def test_a_compressed_bag_is_read_up_to_a_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: str
) -> None:
    bag = tmp_path / "bag"
    mode = CompressionMode.FILE if compression == "file" else CompressionMode.MESSAGE
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer2(bag, version=8, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/text", "std_msgs/msg/String", typestore=store)
        message = store.types["std_msgs/msg/String"]("0" * 3_000_000)
        writer.write(connection, START, store.serialize_cdr(message, "std_msgs/msg/String"))
    with Bag(bag) as read:
        assert len(next(read.messages("/text"))[1].data) == 3_000_000
    monkeypatch.setattr(bounded, "ALWAYS", 1 << 20)
    with pytest.raises(DataError, match="hold more than 1 MB"), Bag(bag) as read:
        next(read.messages("/text"))


def test_twelve_bits_of_a_bag_keep_their_brightness() -> None:
    deep = (IMAGES[0].astype(np.uint16) << 4) | 3
    data = np.frombuffer(deep.astype("<u2").tobytes(), np.uint8)
    size = {"height": HEIGHT, "width": WIDTH, "step": 2 * WIDTH}
    message = SimpleNamespace(encoding="mono16", is_bigendian=0, data=data, **size)
    assert messages.extent_in(message).largest == deep.max()
    np.testing.assert_array_equal(messages.image_of(message, "it", Range(0, 12)), IMAGES[0])
    np.testing.assert_array_equal(messages.image_of(message, "it", Range(0, 10)), np.minimum(deep >> 2, 255))

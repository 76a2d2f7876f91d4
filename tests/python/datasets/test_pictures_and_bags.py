"""Pictures of every encoding, bags that were cut or lost their metadata, and depth in other units."""

from __future__ import annotations

import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from collabslam.cli.main import main
from collabslam.datasets import open_recording
from collabslam.datasets.deep_range import Range, RunningRange, extent_of
from collabslam.datasets.depth_image import MILLIMETRES
from collabslam.datasets.gate import listening
from collabslam.datasets.image_header import read_header
from collabslam.datasets.images import decode, decode_grey, used_range
from collabslam.datasets.mosaic import RunningMosaic
from collabslam.datasets.ros import messages
from collabslam.datasets.ros.bag import Bag, BagImages
from collabslam.errors import DataError
from collabslam.types import Image

pytest.importorskip("rosbags")
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

HEIGHT, WIDTH = 48, 64
START = 1_700_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_HUMBLE)


def picture(seed: int = 0) -> Image:
    rng = np.random.default_rng(seed)
    rough = rng.integers(0, 255, (6, 8), dtype=np.uint8)
    return np.asarray(cv2.resize(rough, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC), np.uint8)


def message(encoding: str, data: Any, step: int, big: int = 0) -> Any:
    return SimpleNamespace(height=HEIGHT, width=WIDTH, encoding=encoding, step=step, is_bigendian=big,
                           data=np.frombuffer(bytes(data), np.uint8))  # fmt: skip


def compressed(form: str, data: bytes) -> Any:
    return SimpleNamespace(format=form, data=np.frombuffer(data, np.uint8))


def test_yuv_and_planes_give_their_brightness() -> None:
    grey = picture()
    chroma = np.full_like(grey, 128)
    uyvy, yuyv = np.stack([chroma, grey], -1), np.stack([grey, chroma], -1)
    for name in ("yuv422", "uyvy"):
        np.testing.assert_array_equal(messages.image_of(message(name, uyvy.tobytes(), 2 * WIDTH), "x"), grey)
    for name in ("yuv422_yuy2", "yuyv"):
        np.testing.assert_array_equal(messages.image_of(message(name, yuyv.tobytes(), 2 * WIDTH), "x"), grey)
    planes = np.concatenate([grey.ravel(), np.full(WIDTH * HEIGHT // 2, 128, np.uint8)])
    np.testing.assert_array_equal(messages.image_of(message("nv12", planes.tobytes(), WIDTH), "x"), grey)


@pytest.mark.parametrize("big", [0, 1])
@pytest.mark.parametrize("name", ["rgb16", "bgra16", "16UC3", "8UC4", "bayer_rggb16"])
def test_deep_and_wide_pixels(name: str, big: int) -> None:
    grey = picture()
    channels = 1 if "bayer" in name else 4 if name in ("bgra16", "8UC4") else 3
    kind = "u1" if name.startswith("8") else (">u2" if big else "<u2")
    values = np.repeat(grey[:, :, None], channels, axis=2).astype(kind)
    values = values if kind == "u1" else (values * 16).astype(kind)
    found = messages.image_of(message(name, values.tobytes(), values.strides[0], big), "x", Range(0, 12))
    inner = (slice(2, -2), slice(2, -2)) if "bayer" in name else (slice(None), slice(None))
    limit = 25 if "bayer" in name else 1  # neighbours are mixed
    assert np.abs(found[inner].astype(int) - grey[inner]).max() <= limit


def test_a_mosaic_in_a_compressed_message_is_no_grey_picture() -> None:
    grey = np.full((HEIGHT, WIDTH), 100, np.uint8)
    mosaic = grey.copy()
    mosaic[0::2, 0::2], mosaic[1::2, 1::2] = 200, 20
    data = cv2.imencode(".png", mosaic)[1].tobytes()
    found = messages.image_of(compressed("bayer_rggb8; png compressed ", data), "x")
    raw = messages.image_of(message("bayer_rggb8", mosaic.tobytes(), WIDTH), "x")
    np.testing.assert_array_equal(found, raw)
    assert np.ptp(found[4:-4, 4:-4]) <= 2
    colour = cv2.imencode(".png", cv2.cvtColor(picture(), cv2.COLOR_GRAY2BGR))[1].tobytes()
    np.testing.assert_array_equal(
        messages.image_of(compressed("bayer_rggb8; png compressed bgr8", colour), "x"), picture()
    )


@pytest.mark.parametrize("form", ["h264", "hevc", "bgr8; ffmpeg"])
def test_a_part_of_a_film_is_told(form: str) -> None:
    with pytest.raises(DataError, match="part of a film"):
        messages.image_of(compressed(form, b"\0\0\0\1gx"), "x")


def test_what_follows_a_jpeg_is_no_part_of_it(tmp_path: Path) -> None:
    data = cv2.imencode(".jpg", picture())[1].tobytes()
    trailer = b"\0\0\1\x0a\x0e\0\0\0Image_UTC_Data" + bytes(range(255)) + b"SEFT"
    np.testing.assert_array_equal(decode(data + trailer, "x"), decode(data, "x"))
    assert read_header(data[: len(data) * 7 // 10]) is None
    assert read_header(data[: len(data) * 7 // 10] + trailer) is None


def test_jpegs_and_tiffs_that_two_decoders_read_differently_are_none() -> None:
    data = cv2.imencode(".jpg", picture())[1].tobytes()
    start = data.index(b"\xff\xc0")
    other = bytearray(data[start : start + 19])
    other[5:9] = struct.pack(">HH", 4, 4)
    assert read_header(data[:2] + bytes(other) + data[2:]) is None
    assert read_header(data[:2] + b"\xff\x01" + data[2:]) == read_header(data)
    scan = b"\xff\xda\0\x08\1\1\0\0\0\0"
    end = data.rindex(b"\xff\xd9")
    assert read_header(data[:end] + scan * 2 + data[end:]) is not None
    assert read_header(data[:end] + scan * 500 + data[end:]) is None


def test_deep_files_and_deep_messages_have_one_range(tmp_path: Path) -> None:
    used_range.cache_clear()
    shades = [(picture().astype(np.uint16) * 16) >> k for k in range(3)]
    for k, image in enumerate(shades):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    expected = [decode_grey(tmp_path / f"{k}.png") for k in range(3)]
    assert expected[0].max() > 200
    rows = [("/cam/image_raw/compressed", START + k, png(image)) for k, image in enumerate(shades)]
    rows += [("/cam/image_raw", START + k, image16(image)) for k, image in enumerate(shades)]
    with Bag(bag(tmp_path / "bag", rows)) as opened:
        for topic in ("/cam/image_raw/compressed", "/cam/image_raw"):
            images = BagImages(opened, topic)
            for k in range(3):
                np.testing.assert_array_equal(images.read(k), expected[k])


def test_one_broken_pixel_costs_one_image(tmp_path: Path) -> None:
    used_range.cache_clear()
    shade = picture().astype(np.uint16) * 16
    broken = shade.copy()
    broken[3, 5] = 65535
    for k in range(60):
        cv2.imwrite(str(tmp_path / f"{k}.png"), broken if k == 7 else shade)
    rows = [("/cam/image_raw", START + k, image16(broken if k == 7 else shade)) for k in range(60)]
    with Bag(bag(tmp_path / "bag", rows)) as opened:
        images = BagImages(opened, "/cam/image_raw")
        for k in (0, 7, 59):
            expected = (shade >> 4).astype(np.uint8)
            expected[3, 5] = 255 if k == 7 else expected[3, 5]
            np.testing.assert_array_equal(images.read(k), expected)
            np.testing.assert_array_equal(decode_grey(tmp_path / f"{k}.png"), expected)


def thermal(k: int) -> Any:
    """Counts of a thermal camera in 14 bits: a room spreads over 500 of them, and the sensor drifts."""
    return (7000 + 2 * k + 500.0 / 255.0 * picture(k)).astype(np.uint16)


def test_thermal_pictures_have_one_range_that_shows_them(tmp_path: Path) -> None:
    for k in range(12):
        cv2.imwrite(str(tmp_path / f"{k}.png"), thermal(k))
        cv2.imwrite(str(tmp_path / f"{k}.pgm"), thermal(k))  # which states 16 bits, whatever there is
    rows = [("/raw", START + k, image16(thermal(k))) for k in range(12)]
    rows += [("/raw/compressed", START + k, png(thermal(k))) for k in range(12)]
    with Bag(bag(tmp_path / "bag", rows)) as opened, listening() as facts:
        raw, packed = (BagImages(opened, topic) for topic in ("/raw", "/raw/compressed"))
        seen = [raw.read(k) for k in range(12)]
        assert all(np.ptp(image) > 100 for image in seen)
        slopes = [np.polyfit(thermal(k).ravel(), seen[k].ravel(), 1) for k in range(12)]
        np.testing.assert_allclose(slopes, np.tile(slopes[0], (12, 1)), rtol=0.02)  # one range for all
        for k in range(12):
            np.testing.assert_array_equal(packed.read(k), seen[k])
            np.testing.assert_array_equal(decode_grey(tmp_path / f"{k}.png"), seen[k])
            np.testing.assert_array_equal(decode_grey(tmp_path / f"{k}.pgm"), seen[k])
    assert any(fact.what == "depth of pixels" and "bits above" in fact.value for fact in facts)


def test_a_live_range_stays_as_long_as_it_holds() -> None:
    running = RunningRange()
    ranges = [running.of(extent_of(thermal(k))) for k in range(12)]
    assert len(set(ranges)) <= 2
    assert all(np.ptp(of.grey(thermal(k))) > 100 for k, of in enumerate(ranges))
    hot = thermal(0)
    hot[:, :32] += 3000
    assert running.of(extent_of(hot)) == ranges[-1]  # one image alone may be broken
    wide = running.of(extent_of(hot))
    assert wide.holds(7000, 10000)


# --- mosaics that do not say so ---------------------------------------------------------------


def scene() -> Any:
    """A coloured picture, (H, W, 3) BGR."""
    rng = np.random.default_rng(4)
    rough = rng.integers(20, 235, (6, 8, 3), dtype=np.uint8)
    return cv2.resize(rough, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)


def mosaic(colour: Any, green_first: bool) -> Any:
    """What a sensor under rggb (or grbg) filters has of a picture."""
    order = ((1, 2), (0, 1)) if green_first else ((2, 1), (1, 0))
    out = np.empty((HEIGHT, WIDTH), np.uint8)
    for row in range(2):
        for column in range(2):
            out[row::2, column::2] = colour[row::2, column::2, order[row][column]]
    return out


@pytest.mark.parametrize("green_first", [False, True])
def test_a_mosaic_that_is_said_to_be_grey_is_known_by_its_neighbours(
    tmp_path: Path, green_first: bool
) -> None:
    raw, wanted = mosaic(scene(), green_first), cv2.cvtColor(scene(), cv2.COLOR_BGR2GRAY).astype(float)
    cv2.imwrite(str(tmp_path / "0.png"), raw)
    rows = [("/raw", START, image(0, raw)), ("/raw/compressed", START, png(raw))]
    with listening() as facts:
        found = [decode_grey(tmp_path / "0.png")]
        with Bag(bag(tmp_path / "bag", rows)) as opened:
            found += [BagImages(opened, topic).read(0) for topic in ("/raw", "/raw/compressed")]
    assert [fact.what for fact in facts].count("pixels") == 3
    for one in found:
        assert np.abs(one - wanted).mean() < 0.5 * np.abs(raw - wanted).mean()


def test_a_streams_first_pictures_tell_whether_it_is_a_mosaic() -> None:
    raw, blank, rough = (
        mosaic(scene(), True),
        np.full((HEIGHT, WIDTH), 7, np.uint8),
        np.indices((HEIGHT, WIDTH)),
    )
    crossed = (60 * (rough.sum(0) % 2)).astype(np.uint8)  # one picture alone may look like one
    running = RunningMosaic()
    assert [running.of(one) for one in (blank, None, raw)] == [None, None, cv2.COLOR_BayerGB2GRAY]
    running = RunningMosaic()
    assert running.of(crossed) is not None
    assert [running.of(picture(k)) for k in range(3)] == [None] * 3


def test_what_is_grey_is_no_mosaic(tmp_path: Path) -> None:
    grey = picture()
    noise = np.random.default_rng(1).integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)
    lines = np.where(np.arange(HEIGHT)[:, None] % 2, noise, 255 - noise)  # an interlaced one
    for k, one in enumerate((grey, noise, lines)):
        folder = tmp_path / str(k)
        folder.mkdir()
        cv2.imwrite(str(folder / "0.png"), one)
        np.testing.assert_array_equal(decode_grey(folder / "0.png"), one)


def test_a_wrong_order_of_bytes_is_put_right() -> None:
    smooth = cv2.GaussianBlur(picture(), (0, 0), 3.0).astype(np.uint16) * 16
    for big in (0, 1):
        for order in ("<u2", ">u2"):
            message = image16(smooth.astype(order))
            message.is_bigendian = big
            assert messages.extent_in(message).largest == smooth.max()
            np.testing.assert_array_equal(messages.image_of(message, "x", Range(0, 12)), smooth >> 4)


def test_depth_of_kilometres_is_in_millimetres() -> None:
    metres = np.full((HEIGHT, WIDTH), 2.0, np.float32)
    message = STORE.types["sensor_msgs/msg/Image"](
        header(0), HEIGHT, WIDTH, "32FC1", 0, 4 * WIDTH, metres.view(np.uint8).ravel()
    )
    assert (messages.depth_of(message, "x", MILLIMETRES) == 2.0).all()
    message.data = (1000 * metres).view(np.uint8).ravel()
    with pytest.raises(DataError, match=r"2000 m .* millimetres"):
        messages.depth_of(message, "x", MILLIMETRES)


# --- bags -------------------------------------------------------------------------------------


def header(ns: int) -> Any:
    time = STORE.types["builtin_interfaces/msg/Time"](*divmod(ns, 10**9))
    return STORE.types["std_msgs/msg/Header"](time, "cam")


def image(ns: int, grey: Image) -> Any:
    return STORE.types["sensor_msgs/msg/Image"](header(ns), HEIGHT, WIDTH, "mono8", 0, WIDTH, grey.ravel())


def image16(values: Any) -> Any:
    data = np.frombuffer(values.tobytes(), np.uint8)
    return STORE.types["sensor_msgs/msg/Image"](header(0), HEIGHT, WIDTH, "mono16", 0, 2 * WIDTH, data)


def png(values: Any) -> Any:
    data = np.frombuffer(cv2.imencode(".png", values)[1].tobytes(), np.uint8)
    return STORE.types["sensor_msgs/msg/CompressedImage"](header(0), "mono16; png compressed ", data)


def bag(path: Path, rows: list[tuple[str, int, Any]], *, mcap: bool = True) -> Path:
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        topics: dict[str, Any] = {}
        for topic, ns, msg in rows:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, msg.__msgtype__, typestore=STORE)
            writer.write(topics[topic], ns, STORE.serialize_cdr(msg, msg.__msgtype__))
    return path


def walk(count: int) -> list[tuple[str, int, Any]]:
    stamps = [START + 50_000_000 * k for k in range(count)]
    return [("/cam/image_raw", ns, image(ns, picture(k))) for k, ns in enumerate(stamps)]


CAMERA = (
    "camera_model: pinhole\nintrinsics: [60, 60, 31.5, 23.5]\nresolution: [64, 48]\ndistortion_model: none\n"
)


def camera(path: Path, more: str = "") -> Path:
    (path / "camera.yaml").write_text(CAMERA + more)
    return path / "camera.yaml"


def test_a_cut_mcap_is_read_as_far_as_it_is_whole(tmp_path: Path) -> None:
    whole = next(bag(tmp_path / "bag", walk(800)).glob("*.mcap"))
    data = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) * 7 // 10])
    with pytest.warns(UserWarning, match=r"is cut.*mcap recover"):
        found = open_recording(cut, camera=camera(tmp_path))
    assert 100 < len(found) < 800
    np.testing.assert_array_equal(found.image(99), picture(99))
    np.testing.assert_array_equal(found.image(3), picture(3))
    cut.write_bytes(data[:20000])
    with pytest.raises(DataError, match="mcap recover"):
        open_recording(cut, camera=camera(tmp_path))


@pytest.mark.parametrize("mcap", [False, True])
def test_a_folder_of_bags_needs_no_metadata(tmp_path: Path, mcap: bool) -> None:
    folder = bag(tmp_path / "bag", walk(5), mcap=mcap)
    (folder / "metadata.yaml").unlink()
    assert len(open_recording(folder, camera=camera(tmp_path))) == 5


# --- depth ------------------------------------------------------------------------------------


def tum(path: Path) -> Path:
    for name in ("rgb", "depth"):
        (path / name).mkdir(parents=True)
        lines = [f"{1 + 0.05 * k:.2f} {name}/{k}.png\n" for k in range(3)]
        (path / f"{name}.txt").write_text("".join(lines))
    for k in range(3):
        cv2.imwrite(str(path / "rgb" / f"{k}.png"), picture(k))
        cv2.imwrite(str(path / "depth" / f"{k}.png"), np.full((HEIGHT, WIDTH), 2000, np.uint16))
    return path


def test_counts_of_a_metre_are_said_and_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tum(tmp_path / "a")
    for more, given, metres in (("", None, 0.4), ("", 1000.0, 2.0), ("DepthMapFactor: 500\n", None, 4.0)):
        with listening() as facts:
            recording = open_recording(path, camera=camera(tmp_path, more), depth_scale=given)
        depth = recording.frame(0).depth
        assert depth is not None
        np.testing.assert_allclose(depth.depth, metres)
        assert any(fact.what == "depth" and f"{2000 / metres:g} counts" in fact.value for fact in facts)
    assert main(["info", str(path), "--camera", str(tmp_path / "camera.yaml"), "--depth-scale", "1000"]) == 0
    assert "1000 counts a metre (--depth-scale)" in capsys.readouterr().out
    with pytest.raises(DataError, match="counts a metre"):
        open_recording(path, camera=camera(tmp_path), depth_scale=1.0)


def test_compressed_depth_is_read() -> None:
    counts = np.full((HEIGHT, WIDTH), 2500, np.uint16)
    counts[0] = 0
    data = cv2.imencode(".png", counts)[1].tobytes()
    for form, head in (("16UC1; png compressed", b""), ("16UC1; compressedDepth png", bytes(12))):
        metres = messages.depth_of(compressed(form, head + data), "x", MILLIMETRES)
        assert (metres[0, 0], metres[1, 0]) == (0.0, 2.5)
    head = struct.pack("<iff", 0, 5000.0, 1500.0)
    metres = messages.depth_of(compressed("32FC1; compressedDepth", head + data), "x", MILLIMETRES)
    assert np.isnan(metres[0, 0])
    assert metres[1, 0] == 5.0

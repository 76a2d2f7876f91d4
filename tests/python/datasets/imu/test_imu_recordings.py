"""The gyroscope of a recording: EuRoC's, our own, a bag's, a file beside it; written, named and left out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from helpers.bags import FRAMES, IMAGES, START, STEP, Maker
from helpers.folders import START_NS, make_euroc, write_images
from helpers.gyro import lines, samples

from collabslam import InputError, RecordingWriter, open_recording
from collabslam.cli import main as cli
from collabslam.datasets import write_recording
from collabslam.datasets.gate import listening
from collabslam.datasets.imu.beside import GyroGiven
from collabslam.datasets.imu.description import MOUNTS
from collabslam.datasets.opening import DiskRecording
from collabslam.datasets.overrides import Given
from collabslam.datasets.ros.writer import write_bag
from collabslam.datasets.source import STATE, Source
from collabslam.datasets.wrapped import FirstFrames
from collabslam.errors import DataError
from collabslam.geometry import pose, rotation_exp
from collabslam.types import Array, Imu, ImuLog

R_CB = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Of the cameras that `make_euroc` writes: body to camera."""
R_BS = rotation_exp([0.1, 0.2, -0.3])
FIRST = START_NS / 1e9 - 0.1
TIMES, RATES = samples(FIRST, 0.4)
GRAVITY = np.tile([0.1, -9.7, 0.9], (len(TIMES), 1))
SENSOR = f"""sensor_type: imu
comment: VI-Sensor IMU
T_BS: {{rows: 4, cols: 4, data: {pose(R_BS, [0.1, 0, 0]).ravel().tolist()}}}
rate_hz: 200
gyroscope_noise_density: 1.6968e-04
gyroscope_random_walk: 1.9393e-05
accelerometer_noise_density: 2.0000e-3
accelerometer_random_walk: 3.0000e-3
"""


def with_imu(root: Path, sensor: str | None = SENSOR, columns: tuple[Array, ...] = (RATES, GRAVITY)) -> Path:
    make_euroc(root)
    folder = root / "mav0" / "imu0"
    folder.mkdir()
    if sensor is not None:
        (folder / "sensor.yaml").write_text(sensor)
    (folder / "data.csv").write_text("#timestamp [ns],w\n" + lines([f"{t:.9f}" for t in TIMES], *columns))
    stamps = [str(START_NS - 100_000_000 + 5_000_000 * k) for k in range(len(TIMES))]
    (folder / "data.csv").write_text("#timestamp [ns],w\n" + lines(stamps, *columns))
    return root


def log_of(recording: DiskRecording) -> ImuLog:
    assert recording.imu is not None
    return recording.imu


def told(path: Path, given: GyroGiven | None = None, **others: Any) -> tuple[DiskRecording, str]:
    with listening() as facts:
        recording = open_recording(path, sensors=() if given is None else (given,), **others)
    return recording, "; ".join(f"{fact.what}: {fact.value}" for fact in facts)


def test_euroc_has_its_own(tmp_path: Path) -> None:
    root = with_imu(tmp_path)
    for path in (root, root / "mav0"):
        log = log_of(open_recording(path))
        np.testing.assert_allclose(log.times, TIMES, atol=1e-6)
        np.testing.assert_array_equal(log.rates, RATES)
        np.testing.assert_array_equal(log.accelerations, GRAVITY)
        np.testing.assert_allclose(log.sensor.r_ci, R_CB @ R_BS, atol=1e-12)
        assert log.sensor.gyro_noise == 1.6968e-4
        assert log.sensor.gyro_bias_walk == 1.9393e-5
        assert log.sensor.mount_sd is None
    assert open_recording(root, sensors=(GyroGiven("none"),)).imu is None
    # What is told beside it counts for more.
    (tmp_path / "imu.yaml").write_text("gyroscope_noise_density: 0.002\naxes: ros\n")
    log = log_of(open_recording(root, sensors=(GyroGiven(imu=str(tmp_path / "imu.yaml")),)))
    np.testing.assert_array_equal(log.sensor.r_ci, MOUNTS["ros"])
    assert log.sensor.gyro_noise == 0.002
    assert log.sensor.gyro_bias_walk == 1.9393e-5


def test_one_that_nobody_says_how_it_sits_is_passed_over(tmp_path: Path) -> None:
    root = with_imu(tmp_path, sensor=None)
    recording, text = told(root)
    assert recording.imu is None
    assert "passed over: gyroscope (nothing tells how it sits" in text
    # The camchain-imucam that goes with it tells it.
    lens = {"camera_model": "pinhole", "intrinsics": [30.0, 31.0, 15.5, 11.5], "resolution": [32, 24]}
    chain = {"cam0": lens | {"T_cam_imu": pose(R_BS, np.zeros(3)).tolist(), "timeshift_cam_imu": 0.01}}
    (tmp_path / "chain.yaml").write_text(yaml.safe_dump(chain))
    log = log_of(open_recording(root, camera=tmp_path / "chain.yaml"))
    np.testing.assert_allclose(log.sensor.r_ci, R_BS, atol=1e-12)
    assert log.sensor.time_offset == -0.01


def test_a_broken_one_is_refused_and_can_be_left_out(tmp_path: Path) -> None:
    root = with_imu(tmp_path, columns=(np.rad2deg(RATES) * 3,))
    with pytest.raises(DataError, match=r"degrees a second.*--gyro none"):
        open_recording(root)
    assert len(open_recording(root, sensors=(GyroGiven("none"),))) == 4
    (root / "mav0" / "imu0" / "data.csv").write_text(lines([f"{k / 200}" for k in range(80)], RATES))
    with pytest.raises(DataError, match=r"share no time.*timeshift_cam_imu.*--gyro none"):
        open_recording(root)


def test_what_is_written_reads_back(tmp_path: Path) -> None:
    source = open_recording(with_imu(tmp_path / "euroc"))
    sensor = replace(log_of(source).sensor, time_offset=0.003, mount_sd=0.01)
    source = replace(source, imu=replace(log_of(source), sensor=sensor))
    write_recording(source, tmp_path / "walk")
    read = open_recording(tmp_path / "walk")
    log = log_of(read)
    np.testing.assert_array_equal(log.times, log_of(source).times)
    np.testing.assert_array_equal(log.rates, RATES)
    np.testing.assert_array_equal(log.accelerations, GRAVITY)
    np.testing.assert_allclose(log.sensor.r_ci, sensor.r_ci, atol=1e-12)
    assert (log.sensor.time_offset, log.sensor.gyro_noise) == (0.003, 1.6968e-4)
    assert log.sensor.mount_sd == pytest.approx(0.01)
    write_recording(read, tmp_path / "again")
    for name in ("data.csv", "sensor.yaml"):
        first, second = (tmp_path / folder / "imu0" / name for folder in ("walk", "again"))
        assert first.read_bytes() == second.read_bytes()
    write_bag(read, tmp_path / "bag")
    bag = log_of(open_recording(tmp_path / "bag"))
    np.testing.assert_allclose(bag.times, log.times + 0.003, atol=2e-9 + 2e-7)
    np.testing.assert_array_equal(bag.rates, RATES)
    np.testing.assert_array_equal(bag.accelerations, GRAVITY)
    np.testing.assert_allclose(bag.sensor.r_ci, sensor.r_ci, atol=1e-12)
    first = FirstFrames(read, 2)
    assert first.imu is log


def test_the_writer_takes_samples_beside_frames(tmp_path: Path) -> None:
    source = open_recording(make_and_return(tmp_path / "euroc"))
    force = np.full(3, 5.7)
    with RecordingWriter(tmp_path / "walk", source.camera, imu=Imu(MOUNTS["ros"])) as writer:
        for k, t in enumerate(TIMES.tolist()):
            writer.add_gyro(t, RATES[k], force if k % 2 else [np.nan] * 3)
        for arguments, message in {
            (TIMES[-1], (0.0, 0.0, 0.0), (0.0, 0.0, 9.8)): "does not follow",
            (TIMES[-1] + 1, (0.0, 0.0), (0.0, 0.0, 9.8)): "rate has the shape",
            (TIMES[-1] + 1, (np.nan, 0.0, 0.0), (0.0, 0.0, 9.8)): "not finite",
            (TIMES[-1] + 1, (0.0, 0.0, 0.0), (0.0, 9.8)): "acceleration has the shape",
            (TIMES[-1] + 1, (0.0, 0.0, 0.0), None): "give NaN where it lacks",
        }.items():
            with pytest.raises(InputError, match=message):
                writer.add_gyro(*arguments)
        for i in range(len(source)):
            writer.add(source.times[i], source.image(i))
    log = log_of(open_recording(tmp_path / "walk"))
    assert len(log) == len(TIMES)
    assert log.accelerations is not None
    assert np.isnan(log.accelerations[::2]).all()
    np.testing.assert_array_equal(log.accelerations[1::2], np.tile(force, (40, 1)))
    np.testing.assert_array_equal(log.sensor.r_ci, MOUNTS["ros"])
    assert log.sensor.gyro_noise is None


def make_and_return(root: Path) -> Path:
    make_euroc(root)
    return root


@pytest.mark.parametrize("imu", [None, "ros", "phone-left"])
def test_a_file_beside_any_recording(tmp_path: Path, imu: str | None) -> None:
    root, file = make_and_return(tmp_path / "euroc"), tmp_path / "gyro.csv"
    file.write_text(lines([f"{t:.6f}" for t in TIMES], RATES))
    recording, text = told(root, GyroGiven(str(file), imu))
    np.testing.assert_array_equal(log_of(recording).sensor.r_ci, np.eye(3) if imu is None else MOUNTS[imu])
    assert ("those of Cs (--imu tells others)" in text) == (imu is None)
    with pytest.raises(DataError, match="not a bag with such a topic; give a CSV"):
        open_recording(root, sensors=(GyroGiven("/imu"),))
    with pytest.raises(DataError, match="no gyroscope that --imu could tell of"):
        open_recording(root, sensors=(GyroGiven(imu="ros"),))


def test_a_body_is_no_camera(tmp_path: Path) -> None:
    """T_BS counts where that of the camera is known, and is never taken for the mount itself."""
    root = with_imu(tmp_path / "euroc")
    data, file = root / "mav0" / "imu0" / "data.csv", tmp_path / "gyro.csv"
    for source in (data, data.parent):
        np.testing.assert_allclose(
            log_of(told(root, GyroGiven(str(source)))[0]).sensor.r_ci, R_CB @ R_BS, atol=1e-12
        )
    file.write_text(lines([f"{t:.6f}" for t in TIMES], RATES))
    (tmp_path / "imu.yaml").write_text(SENSOR)
    given = GyroGiven(str(file), str(tmp_path / "imu.yaml"))
    np.testing.assert_allclose(log_of(told(root, given)[0]).sensor.r_ci, R_CB @ R_BS, atol=1e-12)
    lens = "intrinsics: [30, 30, 15, 11]\nresolution: [32, 24]\ncamera_model: pinhole\n"
    (tmp_path / "camera.yaml").write_text(lens)
    write_images(tmp_path / "film", [f"{FIRST + 0.1 * k:.6f}.png" for k in range(4)])
    with pytest.raises(DataError, match=r"nothing tells how the camera .* sits there; give T_cam_imu"):
        told(tmp_path / "film", given, camera=tmp_path / "camera.yaml")


@pytest.mark.parametrize("size", [(32, 24), (24, 32)])
def test_a_phones_log_lies_along_the_phone(tmp_path: Path, size: tuple[int, int]) -> None:
    write_images(tmp_path / "film", [f"{k}.png" for k in range(4)], size=size)
    lens = (
        f"intrinsics: [30, 30, {size[0] // 2 - 1}, {size[1] // 2 - 1}]\n"
        f"resolution: [{size[0]}, {size[1]}]\nrate: 20\ncamera_model: pinhole\n"
    )
    (tmp_path / "camera.yaml").write_text(lens)
    file, elapsed = tmp_path / "Gyroscope.csv", np.arange(len(TIMES))[:, None] / 200
    stamps = [f"{1_700_000_000_000_000_000 + 5_000_000 * k}" for k in range(len(TIMES))]
    file.write_text("time,seconds_elapsed,z,y,x\n" + lines(stamps, elapsed, RATES[:, ::-1]))
    film = {"camera": tmp_path / "camera.yaml"}
    if size[0] > size[1]:
        with pytest.raises(DataError, match=r"wide.*--imu phone-left or --imu phone-right"):
            told(tmp_path / "film", GyroGiven(str(file)), **film)
        recording, _ = told(tmp_path / "film", GyroGiven(str(file), "phone-right"), **film)
    else:
        recording, text = told(tmp_path / "film", GyroGiven(str(file)), **film)
        assert "a phone held upright" in text
        np.testing.assert_array_equal(log_of(recording).sensor.r_ci, MOUNTS["opengl"])
    # The film counts from 0, and so does the log's second clock.
    np.testing.assert_allclose(log_of(recording).times[3], 0.015)


FULL, NONE = np.zeros(9), np.r_[-1.0, np.zeros(8)]


def bag_with(
    path: Path, topics: dict[str, str], tf: Array | None = None, turns: Array = FULL, forces: Array = FULL
) -> Path:
    """A bag of images whose frame is "cam", and of samples of each topic in a frame."""
    maker = Maker(path, "mcap")
    vector = "geometry_msgs/msg/Vector3"
    with maker.writer:
        for k in range(FRAMES):
            maker.image("/cs/image_raw", START + k * STEP, IMAGES[k])
            maker.camera("/cs/camera_info", START + k * STEP)
            if tf is not None:
                maker.link("/tf", START + k * STEP, "cam", "imu_link", tf)
        for topic, frame in topics.items():
            for k, rate in enumerate(samples(0.0, 0.6)[1]):
                t = START + 5_000_000 * k
                maker.write(topic, "sensor_msgs/msg/Imu", t, maker.header(t, frame),
                            maker.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0), FULL,
                            maker.make(vector, *rate), turns,
                            maker.make(vector, 0.0, 0.0, 9.81), forces)  # fmt: skip
    return maker.path


def test_a_bags_only_topic_is_taken_where_tf_tells_how_it_sits(tmp_path: Path) -> None:
    t_ci = pose(R_BS, [0.1, 0.0, 0.0])
    log = log_of(open_recording(bag_with(tmp_path / "a", {"/imu/data": "imu_link"}, t_ci)))
    np.testing.assert_allclose(log.rates, samples(0.0, 0.6)[1])
    np.testing.assert_allclose(log.times[1], START / 1e9 + 0.005, atol=1e-6)
    np.testing.assert_allclose(log.sensor.r_ci, R_BS, atol=1e-9)
    assert log.accelerations is not None
    # The frame of the images themselves.
    same = open_recording(bag_with(tmp_path / "b", {"/imu/data": "cam"}, forces=NONE))
    np.testing.assert_array_equal(log_of(same).sensor.r_ci, np.eye(3))
    assert log_of(same).accelerations is None


def test_a_topic_without_a_mount_needs_one(tmp_path: Path) -> None:
    bag = bag_with(tmp_path / "walk", {"/imu": "imu_link"})
    recording, text = told(bag)
    assert recording.imu is None
    assert "tf does not link its frame 'imu_link'" in text
    with pytest.raises(DataError, match=r"how the gyroscope of /imu.* sits.*--imu ros"):
        told(bag, GyroGiven("/imu"))
    recording, _ = told(bag, GyroGiven("/imu", "ros"))
    np.testing.assert_array_equal(log_of(recording).sensor.r_ci, MOUNTS["ros"])
    with pytest.raises(DataError, match=r"no topic /gyro; its topics are: .*/imu"):
        told(bag, GyroGiven("/gyro", "ros"))
    with pytest.raises(DataError, match="is a sensor_msgs/msg/Image"):
        told(bag, GyroGiven("/cs/image_raw", "ros"))


def test_a_covariance_of_minus_one_says_that_there_is_none(tmp_path: Path) -> None:
    bag = bag_with(tmp_path / "walk", {"/imu": "cam"}, turns=NONE)
    recording, text = told(bag)
    assert recording.imu is None
    assert "there is no angular velocity" in text
    with pytest.raises(DataError, match="is not a gyroscope"):
        told(bag, GyroGiven("/imu"))


def test_of_several_topics_none_is_taken_by_itself(tmp_path: Path) -> None:
    bag = bag_with(tmp_path / "walk", {"/a": "cam", "/b": "cam"})
    recording, text = told(bag)
    assert recording.imu is None
    assert "passed over: /a, /b (--gyro TOPIC takes one of them)" in text
    assert told(bag, GyroGiven("/b"))[0].imu is not None


def test_a_run_goes_on_with_the_same_gyroscope(tmp_path: Path) -> None:
    file = tmp_path / "gyro.csv"
    file.write_text("")
    for given in (GyroGiven(str(file), "ros"), GyroGiven("/imu", str(file)), GyroGiven("none"), None):
        state = Source(tmp_path.resolve(), Given(gyro=given)).state()
        STATE(state, "source")
        assert Source.from_state(state).given.gyro == given


def test_info_shows_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = with_imu(tmp_path)
    assert cli.main(["info", str(root)]) == 0
    text = capsys.readouterr().out
    assert "80 samples at 200 a second, 0.39 s, no gaps; 0 left out" in text
    assert "noise 0.00016968 rad/s/sqrt(Hz)" in text
    assert "+0.0000 s are added" in text
    assert cli.main(["info", str(root), "--gyro", "none"]) == 0
    assert "none (see --gyro)" in capsys.readouterr().out
    assert cli.main(["record", str(root), str(tmp_path / "walk")]) == 0
    assert (tmp_path / "walk" / "imu0" / "data.csv").is_file()
    assert cv2.imread(str(next((tmp_path / "walk" / "cam0" / "data").iterdir()))) is not None

"""A worn camera's own gyroscope in recordings: our own layout's, a file's, a bag's; written and left out."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from helpers.bags import FRAMES, IMAGES, START, STEP, Maker
from helpers.gyro import lines, samples

from collabslam import Camera, InputError, RecordingWriter, WornView, open_recording
from collabslam.cli import main as cli
from collabslam.datasets import write_recording
from collabslam.datasets.imu.beside import GyroGiven, WornGyroGiven
from collabslam.datasets.imu.description import MOUNTS
from collabslam.datasets.imu.worn import rate_at
from collabslam.datasets.opening import DiskRecording
from collabslam.datasets.overrides import Given
from collabslam.datasets.source import STATE, Source
from collabslam.datasets.wrapped import FirstFrames
from collabslam.errors import DataError
from collabslam.simulation import corridor_recording
from collabslam.types import Array, Imu, ImuLog

CAMERA = Camera("pinhole", 32, 24, (30.0, 30.0, 16.0, 12.0))
IMAGE = np.random.default_rng(0).integers(0, 255, (24, 32), np.uint8)
TIMES, RATES = samples(1.0, 1.0)
"""Of the gyroscope, 200 a second."""


def at(t: float) -> Array:
    return np.array([np.interp(t, TIMES, axis) for axis in RATES.T])


def write(path: Path, *names: str, gyro: bool = True) -> Path:
    """Five frames; each person's views are of 30 ms after the first four."""
    persons = names or ("",)
    cameras = dict.fromkeys(names, CAMERA) if names else CAMERA
    with RecordingWriter(path, CAMERA, cameras) as writer:
        for k, t in enumerate(TIMES.tolist() if gyro else []):
            for n, name in enumerate(persons):
                writer.add_worn_gyro(t, RATES[k] * (n + 1), name)
        for i in range(5):
            t = 1.1 + 0.1 * i
            views = [WornView(IMAGE, np.eye(4), np.eye(6), t=t - 0.07, who=name) for name in persons]
            writer.add(t, IMAGE, views)
    return path


def rates_of(recording: DiskRecording) -> dict[str, list[tuple[float, Array | None]]]:
    found: dict[str, list[tuple[float, Array | None]]] = {}
    for i in range(len(recording)):
        frame = recording.frame(i)
        for view in frame.views:
            found.setdefault(view.who, []).append((frame.t if view.t is None else view.t, view.rate))
    return found


@pytest.mark.parametrize("names", [(), ("anna", "ben")])
def test_each_view_has_the_rate_of_its_time(tmp_path: Path, names: tuple[str, ...]) -> None:
    recording = open_recording(write(tmp_path / "walk", *names))
    found = rates_of(recording)
    assert list(found) == list(names or ("",))
    for n, views in enumerate(found.values()):
        assert len(views) == 5
        for t, rate in views:
            np.testing.assert_allclose(rate, at(t) * (n + 1), atol=1e-9)
    # Written again it is the same to the last letter.
    write_recording(recording, tmp_path / "again")
    for file in (tmp_path / "walk").rglob("*.csv"):
        assert file.read_text() == (tmp_path / "again" / file.relative_to(tmp_path / "walk")).read_text()


def test_without_one_or_where_it_is_not_wanted_views_have_none(tmp_path: Path) -> None:
    for recording in (
        open_recording(write(tmp_path / "none", gyro=False)),
        open_recording(write(tmp_path / "left_out"), sensors=(WornGyroGiven("none"),)),
    ):
        assert recording.worn_imu == {}
        assert all(rate is None for _, rate in rates_of(recording)[""])


def test_how_it_sits_and_its_clock_are_told_in_its_folder(tmp_path: Path) -> None:
    path = write(tmp_path / "walk")
    (path / "imu1" / "sensor.yaml").write_text("axes: ros\ntimeshift_cam_imu: 0.02\n")
    for t, rate in rates_of(open_recording(path))[""]:
        np.testing.assert_allclose(rate, MOUNTS["ros"] @ at(t + 0.02), atol=1e-9)
    # T_BS alone tells nothing of Cf.
    (path / "imu1" / "sensor.yaml").write_text(f"T_BS: {json.dumps(np.eye(4).ravel().tolist())}\n")
    assert open_recording(path).worn_imu == {}


def test_a_file_beside_the_recording(tmp_path: Path) -> None:
    path, file = write(tmp_path / "walk", gyro=False), tmp_path / "gyro.csv"
    file.write_text(lines([f"{t:.6f}" for t in TIMES], RATES))
    given = WornGyroGiven(str(file), "ros")
    for t, rate in rates_of(open_recording(path, sensors=(given,)))[""]:
        np.testing.assert_allclose(rate, MOUNTS["ros"] @ at(t), atol=1e-6)
    source = Source(path, Given(gyro=GyroGiven("none"), worn_gyro=given))
    state = source.state()
    STATE(state, "source")
    again = Source.from_state(state)
    assert again.given.worn_gyro == given
    assert type(again.given.worn_gyro) is WornGyroGiven
    assert again.given.gyro == GyroGiven("none")


def test_what_cannot_be_used_is_told(tmp_path: Path) -> None:
    path, file = write(tmp_path / "walk", gyro=False), tmp_path / "gyro.csv"
    file.write_text(lines([f"{t:.6f}" for t in TIMES], np.degrees(RATES) * 10.0))
    with pytest.raises(DataError, match="degrees a second"):
        open_recording(path, sensors=(WornGyroGiven(str(file)),))
    file.write_text(lines([f"{t + 50:.6f}" for t in TIMES], RATES))
    with pytest.raises(DataError, match="share no time"):
        open_recording(path, sensors=(WornGyroGiven(str(file)),))
    with pytest.raises(DataError, match="no gyroscope of Cf that --worn-imu"):
        open_recording(path, sensors=(WornGyroGiven(imu="ros"),))
    with pytest.raises(DataError, match="not a bag with such a topic"):
        open_recording(path, sensors=(WornGyroGiven("/imu"),))
    with pytest.raises(DataError, match="2 worn cameras"):
        open_recording(write(tmp_path / "two", "anna", "ben"), sensors=(WornGyroGiven(str(file)),))


def test_the_writer_refuses_what_is_none(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "walk", CAMERA, CAMERA) as writer:
        writer.add(1.0, IMAGE)
        writer.add_worn_gyro(1.0, [0.0, 0.0, 0.1])
        for arguments, message in {
            (1.0, (0.0, 0.0, 0.0)): "does not follow",
            (2.0, (0.0, 0.0)): "rate has the shape",
            (2.0, (np.nan, 0.0, 0.0)): "not finite",
            (2.0, (0.0, 0.0, 0.0), "anna"): "no worn camera 'anna'",
        }.items():
            with pytest.raises(InputError, match=message):
                writer.add_worn_gyro(*arguments)  # type: ignore[arg-type]


def test_a_gap_tells_nothing() -> None:
    kept = (TIMES < 1.3) | (TIMES > 1.5)
    log = ImuLog(TIMES[kept], RATES[kept], None, Imu(np.eye(3), time_offset=0.01), 0)
    assert rate_at(log, 1.4) is None
    assert rate_at(log, float(TIMES[-1]) + 0.02) is None
    assert rate_at(log, 0.9) is None
    np.testing.assert_allclose(rate_at(log, 1.21), at(1.2), atol=1e-9)


TOPICS = {"cs": "/cs/image_raw", "cf": "/cf/image_raw", "t_cf": "/t_cf"}


def bag_with_both(path: Path, imus: list[str]) -> Path:
    """Images of Cs and Cf, T_CF, and a gyroscope of each topic in the frame of the images."""
    maker = Maker(path, "mcap")
    zero = np.zeros(9)
    with maker.writer:
        for k in range(FRAMES):
            t = START + k * STEP
            for name in ("/cs", "/cf"):
                maker.image(f"{name}/image_raw", t, IMAGES[k])
                maker.camera(f"{name}/camera_info", t)
            maker.pose_cov("/t_cf", t, np.eye(4), np.eye(6))
        for topic in imus:
            for k, rate in enumerate(RATES):
                t = START + 5_000_000 * k
                maker.write(topic, "sensor_msgs/msg/Imu", t, maker.header(t),
                            maker.make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0), zero,
                            maker.make("geometry_msgs/msg/Vector3", *rate), zero,
                            maker.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 9.81), zero)  # fmt: skip
    return maker.path


@pytest.mark.parametrize("of_cs", [False, True])
def test_a_topic_of_a_bag_is_that_of_cf_alone(tmp_path: Path, of_cs: bool) -> None:
    bag = bag_with_both(tmp_path / "walk", ["/cf/imu", "/cs/imu"] if of_cs else ["/cf/imu"])
    recording = open_recording(bag, topics=TOPICS, sensors=(WornGyroGiven("/cf/imu"),))
    assert (recording.imu is not None) is of_cs
    views = rates_of(recording)[""]
    assert len(views) >= 3
    rate = dict(zip((START / 1e9 + TIMES - TIMES[0]).tolist(), RATES, strict=True))
    for t, found in views:
        nearest = min(rate, key=lambda at: abs(at - t))
        np.testing.assert_allclose(found, rate[nearest], atol=1e-3)


def test_a_run_says_what_became_of_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = corridor_recording(length_m=1.5)
    with RecordingWriter(tmp_path / "walk", source.camera, source.worn_camera) as writer:
        for k in range(300):
            writer.add_worn_gyro(0.005 * k, [1e-3 * np.sin(k), 0.0, 0.0])
        for i in range(6):
            frame = source.frame(i)
            writer.add(frame.t, frame.image, frame.views if i else ())  # not in the first one
    assert cli.main(["info", str(tmp_path / "walk")]) == 0
    assert "gyroscope of Cf" in capsys.readouterr().out
    assert cli.main(["run", str(tmp_path / "walk"), "--out", str(tmp_path / "out")]) == 0
    assert "told how it turned in" in capsys.readouterr().out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["worn_gyro"]["used"] >= 3
    assert summary["worn_gyro"]["contradicted"] == 0
    with (tmp_path / "out" / "frames.csv").open() as file:
        used = [row["cf_rate_used"] for row in csv.DictReader(file)]
    assert used[0] == ""
    assert used.count("1") == summary["worn_gyro"]["used"]
    again = FirstFrames(open_recording(tmp_path / "walk"), 4)
    write_recording(again, tmp_path / "again")
    gyro = Path("imu1") / "data.csv"
    assert (tmp_path / "again" / gyro).read_text() == (tmp_path / "walk" / gyro).read_text()

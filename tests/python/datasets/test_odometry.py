"""Odometry as motion input: in the dark, with wheels that slip, from files, bags and recordings, resumed."""

from __future__ import annotations

import json
from argparse import ArgumentTypeError
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip, stretched_later
from helpers.driven import COVARIANCE, T_BC, Driven, tf, wheels
from rosbags.rosbag2 import StoragePlugin, Writer

from collabslam import DataError, InputError, RecordingWriter, SettingsError, Slam, open_recording, run
from collabslam.cli import main as cli
from collabslam.cli.options import mount
from collabslam.datasets.gate import listening
from collabslam.datasets.odometry import OdometryGiven, increments, mounted, read_odometry
from collabslam.datasets.overrides import Given
from collabslam.datasets.ros.odometry_topic import read_odometry_topic
from collabslam.datasets.source import STATE as SOURCE_STATE
from collabslam.datasets.source import Source
from collabslam.geometry import pose_inverse
from collabslam.live import messages
from collabslam.live.core import LivePose, OdometrySample
from collabslam.live.plan import LivePlan
from collabslam.live.record import EventReader, EventWriter
from collabslam.live.replay import replay
from collabslam.live.slam import LiveSlam
from collabslam.runs.plan import Output
from collabslam.runs.runner import resume
from collabslam.settings.table import Settings
from collabslam.types import Frame, Odometry, Status


class Alone(Driven):
    """The same without Cf."""

    def __init__(self, clip: Clip, odometry: Odometry | None) -> None:
        super().__init__(clip, odometry)
        self.worn_camera = None

    def frame(self, i: int) -> Frame:
        return replace(super().frame(i), views=())


def way(poses: np.ndarray, a: int, b: int) -> np.ndarray:
    return (pose_inverse(poses[a]) @ poses[b])[:3, 3]


def test_it_carries_the_camera_through_the_dark(clip: Clip) -> None:
    dark = range(6, 13)
    blind = run(Driven(clip, None, dark)).record
    driven = run(Driven(clip, wheels(clip), dark)).record
    assert blind.statuses[12] == Status.LOST
    assert {driven.statuses[i] for i in dark} == {Status.COASTING}
    assert driven.valid.all()
    true = way(clip.recording.truth, 5, 12)
    assert np.linalg.norm(way(driven.poses, 5, 12) - true) < 0.02 * np.linalg.norm(true)
    assert driven.statuses[13] == Status.OK
    # Sure, but not surer than its wheels.
    sd = np.sqrt(np.trace(driven.covariances[12][:3, :3]))
    assert 0.002 < sd < 0.5 * np.sqrt(np.trace(blind.covariances[12][:3, :3]))


@pytest.mark.slow
def test_wheels_that_spin_are_not_believed(clip: Clip) -> None:
    spinning = wheels(clip)
    spinning.twists[(spinning.times > 0.9) & (spinning.times < 1.1)] *= 4.0
    result = run(Driven(clip, spinning))
    assert 1 <= result.summary["frames_slipped"] <= 3
    assert result.summary["frames_ok"] == len(clip.frames)
    still = run(Driven(clip, wheels(clip)))
    assert still.summary["frames_slipped"] == 0
    worse = result.summary["avg_position_error_m"] - still.summary["avg_position_error_m"]
    assert worse < 0.02


def test_odometry_makes_one_camera_metric(clip: Clip) -> None:
    result = run(Alone(clip, wheels(clip)), mode="mono", start="odometry")
    assert result.summary["start"] == "odometry"
    assert result.summary["metric"]
    assert result.summary["unit"] == "metres"
    assert abs(result.summary["scale_error"]) < 0.03  # wheels without error
    # An arbitrary unit has no room for metres.
    slam = Slam(clip.recording.camera, mode="mono", start="scale-free")
    with pytest.raises(InputError, match="arbitrary unit"):
        slam.add_odometry(0.0, np.ones(6), COVARIANCE)
    with pytest.raises(SettingsError, match="needs odometry"):
        run(Driven(clip, None), mode="mono", start="odometry")


@pytest.mark.parametrize(
    ("t", "twist", "covariance", "message"),
    [
        (0.1, [np.nan] * 6, COVARIANCE, "NaN"),
        (0.1, [1.0] * 5, COVARIANCE, "shape"),
        (0.1, np.ones(6), np.zeros((6, 6)), "positive definite"),
        (0.1, np.ones(6), -COVARIANCE, "positive definite"),
        (0.1, np.ones(6), COVARIANCE[:5], "shape"),
        (0.1, 1e9 * np.ones(6), COVARIANCE, "too fast"),
        (0.0, np.ones(6), COVARIANCE, "must increase"),
        (1e4, np.ones(6), COVARIANCE, "give stamps in seconds"),
        ("now", np.ones(6), COVARIANCE, "time stamp"),
    ],
)
def test_bad_odometry_leaves_the_engine_as_it_was(
    clip: Clip, t: Any, twist: Any, covariance: Any, message: str
) -> None:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    slam.add_odometry(0.0, np.ones(6), COVARIANCE)
    before = slam.filter.snapshot()
    with pytest.raises(InputError, match=message):
        slam.add_odometry(t, twist, covariance)
    assert slam.filter.snapshot() == before


@pytest.mark.slow
def test_a_run_goes_on_bit_for_bit(clip: Clip, tmp_path: Path) -> None:
    recording = Driven(clip, wheels(clip), range(8, 10))
    whole = run(recording, out=tmp_path / "whole")

    def stop(frame: Frame, step: Any, engine: Any) -> None:
        if frame.index == 8:
            raise KeyboardInterrupt

    run(recording, out=Output(tmp_path / "parts", checkpoint_every=3), watch=stop)
    again = resume(tmp_path / "parts", recording)
    np.testing.assert_array_equal(again.record.poses, whole.record.poses)
    np.testing.assert_array_equal(again.record.covariances, whole.record.covariances)


@pytest.mark.slow
def test_a_file_serves_the_command_line(clip: Clip, tmp_path: Path) -> None:
    source = clip.recording
    with RecordingWriter(tmp_path / "walk", source.camera, source.worn_camera) as writer:
        for frame in clip.frames[:8]:
            writer.add(frame.t, frame.image, frame.views, truth=source.truth[frame.index])
    odometry = wheels(clip)
    rows = [f"{t!r}," + ",".join(map(repr, row.tolist())) for t, row in _rows(odometry)]
    file = tmp_path / "wheels.csv"
    file.write_text("# stamp, twist\n" + "\n".join(rows) + "\n")
    options = ["run", str(tmp_path / "walk"), "--odometry", str(file), "--overwrite"]
    out = tmp_path / "out"
    mount = ["--odometry-camera", "0.2,0,0.9,0,5,0"]
    assert cli.main([*options, *mount, "--odometry-sd", "0.02,0.01", "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["frames_ok"] == 8
    assert summary["frames_slipped"] == 0
    # What is wrong with it is said at once.
    assert cli.main([*options, *mount, "--out", str(out)]) != 0  # no noise is stated
    assert cli.main(["run", str(tmp_path / "walk"), "--odometry", str(tmp_path / "none.csv")]) != 0
    assert cli.main(["run", str(tmp_path / "walk"), "--odometry-sd", "0.02,0.01"]) != 0


def test_a_checkpoint_knows_where_it_came_from(tmp_path: Path) -> None:
    file = (tmp_path / "wheels.csv").resolve()
    file.write_text("0 1 0 0 0 0 0\n")
    for given in (
        OdometryGiven(str(file), (0.0, 0.1, 0.2), (0.1, 0.2)),
        OdometryGiven("/odom", (0.0, 0.1, 0.2)),
    ):
        source = Source(tmp_path.resolve(), Given(odometry=given))
        state = source.state()
        SOURCE_STATE(state, "source")
        assert Source.from_state(state) == source


def _rows(odometry: Odometry) -> list[tuple[float, np.ndarray]]:
    return list(zip(odometry.times.tolist(), odometry.twists, strict=True))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no odometry"),
        ("0 1 0 0 0 0\n", "columns"),
        ("0 1 0 0 0 0 0\n0 1 0 0 0 0 0\n", "does not follow"),
        ("0 1 0 0 0 0 nan\n", "NaN"),
        ("0 1 0 0 0 0 x\n", "not a number"),
        ("t,vx,vy,wz\n0,1,0,0.1\n", "columns of .* are 't,vx,vy,wz'; name stamp, vx"),
        ("t,vx,vy,vz,wx,wy,wz\n0,1,0,0,0,0\n", "fewer columns than its header names"),
    ],
)
def test_broken_files_are_named(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "wheels.csv"
    file.write_text(text)
    with pytest.raises(DataError, match=message):
        read_odometry(file, OdometryGiven(str(file), (0.0, 0.0, 0.0), (0.1, 0.1)))


@pytest.mark.parametrize(
    "header",
    [
        "wx,wy,wz,stamp,vx,vy,vz",
        "# omega_x omega_y omega_z time v_x v_y v_z",
        "field.twist.twist.angular.x,field.twist.twist.angular.y,field.twist.twist.angular.z,%time,"
        "field.twist.twist.linear.x,field.twist.twist.linear.y,field.twist.twist.linear.z",
    ],
)
def test_columns_are_where_their_names_say(tmp_path: Path, header: str) -> None:
    file = tmp_path / "wheels.csv"
    rows = "".join(f"{0.1 * k},0.2,0.3,{0.05 * k},1.5,0.4,0.6\n" for k in range(3))
    file.write_text(f"{header}\n{rows if ',' in header else rows.replace(',', ' ')}")
    read = read_odometry(file, OdometryGiven(str(file), sd=(0.1, 0.1)))
    np.testing.assert_allclose(read.times, [0.0, 0.05, 0.1])
    np.testing.assert_allclose(read.twists, [[1.5, 0.4, 0.6, 0.1 * k, 0.2, 0.3] for k in range(3)])
    named = tmp_path / "named.csv"
    named.write_text("t,vx,vy,vz,wx,wy,wz,note\n" + "".join(f"{k},1,2,3,4,5,6,7\n" for k in range(2)))
    with listening() as facts:
        again = read_odometry(named, OdometryGiven(str(named), sd=(0.1, 0.1)))
    np.testing.assert_allclose(again.twists, [[1, 2, 3, 4, 5, 6]] * 2)
    assert any(fact.what == "passed over" and "column 8" in fact.value for fact in facts)


def test_odometry_of_another_clock_is_refused_and_of_a_part_is_told(clip: Clip, tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "walk", clip.recording.camera) as writer:
        for frame in clip.frames[:4]:
            writer.add(frame.t, frame.image)
    file = tmp_path / "wheels.csv"
    given = OdometryGiven(str(file), sd=(0.1, 0.1))
    file.write_text("".join(f"{1.7e9 + 0.1 * k:.1f} 1 0 0 0 0 0\n" for k in range(9)))
    with pytest.raises(DataError, match="share no time; give both in the same clock"):
        open_recording(tmp_path / "walk", sensors=[given])
    file.write_text("".join(f"{0.1 * k} 1 0 0 0 0 0\n" for k in range(3)))
    with listening() as facts:
        open_recording(tmp_path / "walk", sensors=[given])
    assert any(fact.value == "covers 3 of 4 frames" for fact in facts)


def test_a_recording_keeps_it(clip: Clip, tmp_path: Path) -> None:
    source, odometry = clip.recording, wheels(clip)
    with RecordingWriter(tmp_path / "walk", source.camera, source.worn_camera, t_bc=T_BC) as writer:
        for frame in clip.frames[:6]:
            writer.add(frame.t, frame.image, frame.views)
        for t, twist, covariance in zip(
            odometry.times[1:], odometry.twists[1:], odometry.covariances[1:], strict=True
        ):
            writer.add_odometry(t, twist, covariance)
        with pytest.raises(InputError, match="does not follow"):
            writer.add_odometry(0.0, odometry.twists[1], COVARIANCE)
        with pytest.raises(InputError, match="positive definite"):
            writer.add_odometry(9.0, odometry.twists[1], np.zeros((6, 6)))
    read = open_recording(tmp_path / "walk").odometry
    assert read is not None
    np.testing.assert_allclose(read.times, odometry.times[1:], atol=1e-9)
    np.testing.assert_array_equal(read.twists, odometry.twists[1:])
    np.testing.assert_array_equal(read.covariances, odometry.covariances[1:])
    np.testing.assert_allclose(read.t_bc, T_BC, atol=1e-12)
    assert run(tmp_path / "walk").summary["frames_ok"] == 6
    data = tmp_path / "walk" / "odometry" / "data.csv"
    data.write_text(data.read_text() + "1,2,3\n")
    with pytest.raises(DataError, match="28 are needed"):
        open_recording(tmp_path / "walk")


def test_increments_lead_from_pose_to_pose() -> None:
    # A quarter of a circle to the left in a second, of radius 1.
    quarter = np.eye(4)
    quarter[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    quarter[:2, 3] = [1.0, 1.0]
    twists = increments(np.array([0.0, 1.0]), np.stack([np.eye(4), quarter]), np.zeros(6))
    np.testing.assert_allclose(twists[1], [np.pi / 2, 0, 0, 0, 0, np.pi / 2], atol=1e-12)


def test_a_live_run_takes_it_and_records_it(clip: Clip, tmp_path: Path) -> None:
    source, odometry = clip.recording, wheels(clip)
    settings = dict(Settings.default().values)
    plan = LivePlan("mono", "odometry", settings, [], [], T_BC.ravel().tolist())
    poses: list[LivePose] = []
    with EventWriter(tmp_path / "record", plan, source.camera, {}) as record:
        slam = Slam(source.camera, mode="mono", start="odometry", t_bc=T_BC)
        with LiveSlam(slam, on_pose=poses.append, on_event=lambda e: record.write(e, 0.0)) as live:
            for t, twist in _rows(odometry)[1:]:
                live.push_odometry(t, twist, COVARIANCE)
            live.push_odometry(0.1, odometry.twists[1], COVARIANCE)
            live.push_odometry(9.0, odometry.twists[1], np.zeros((6, 6)))
            with pytest.raises(InputError, match="The twist has the shape"):
                live.push_odometry(9.0, [1.0], COVARIANCE)
            black = replace(clip.frames[2], image=0 * clip.frames[2].image)
            for frame in (clip.frames[0], clip.frames[1], black):
                live.push_robot(frame.t, frame.image)
    assert len(live.refused) == 2
    assert poses[2].step.status == Status.COASTING
    told, true = np.stack([pose.step.pose for pose in poses]), way(source.truth, 1, 2)
    assert np.linalg.norm(way(told, 1, 2) - true) < 0.05 * np.linalg.norm(true)
    assert replay(tmp_path / "record", tmp_path / "again")["frames"] == 3
    again = np.loadtxt(tmp_path / "again" / "trajectory.tum")
    np.testing.assert_allclose(again[:, 1:4], told[:, :3, 3], atol=1e-6)
    samples = [e for e in EventReader(tmp_path / "record").events() if isinstance(e, OdometrySample)]
    np.testing.assert_array_equal([e.twist for e in samples[:-2]], odometry.twists[1:])
    np.testing.assert_array_equal(samples[-1].covariance, np.zeros((6, 6)))


def test_tf_of_a_bag_says_where_cs_sits(clip: Clip, tmp_path: Path) -> None:
    odometry, turned = wheels(clip), mounted((0.2, 0.0, 0.9, 0.0, 15.0, 0.0))
    with Writer(tmp_path / "bag", version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP) as bag:
        twists = bag.add_connection("/twist", messages.TWIST, typestore=messages.store())
        fixed = bag.add_connection("/tf_static", messages.TRANSFORMS, typestore=messages.store())
        moving = bag.add_connection("/tf", messages.TRANSFORMS, typestore=messages.store())
        link = tf(("base_link", "mast", 0.0, T_BC), ("mast", "cs", 0.0, np.eye(4)))
        bag.write(fixed, 10**9, messages.encoded(messages.TRANSFORMS, link))
        for t, twist in _rows(odometry):
            bag.write(twists, round(1e9 * (t + 1.0)), messages.twist(t + 1.0, twist, COVARIANCE))
            share = (t - odometry.times[0]) / np.ptp(odometry.times)
            head = T_BC if share < 0.5 else turned
            link = tf(("base_link", "steady", t + 1.0, T_BC), ("base_link", "head", t + 1.0, head))
            bag.write(moving, round(1e9 * (t + 1.0)), messages.encoded(messages.TRANSFORMS, link))
    for frame in ("cs", "steady"):
        read = read_odometry_topic(tmp_path / "bag", OdometryGiven("/twist", frames=("base_link", frame)))
        np.testing.assert_allclose(read.t_bc, T_BC, atol=1e-9)
    for frame, message in (("head", "head moves in base_link"), ("cf", "does not say where cf is")):
        with pytest.raises(DataError, match=message):
            read_odometry_topic(tmp_path / "bag", OdometryGiven("/twist", frames=("base_link", frame)))
    given = OdometryGiven("/twist", frames=("base_link", "cs"))
    state = Source(tmp_path / "bag", Given(odometry=given)).state()
    SOURCE_STATE(state, "source")
    assert Source.from_state(state).given.odometry == given
    assert mount("tf:base_link:cs") == ("base_link", "cs")
    for text in ("tf:base_link", "tf::cs", "tf:a:b:c", "1,2"):
        with pytest.raises(ArgumentTypeError):
            mount(text)
    with pytest.raises(DataError, match="not a topic of a bag"):
        OdometryGiven("wheels.csv", frames=("base_link", "cs")).t_bc()


@pytest.mark.parametrize("topic", ["/twist", "/odom"])
def test_a_topic_of_a_bag(clip: Clip, tmp_path: Path, topic: str) -> None:
    odometry = wheels(clip)
    poses = [clip.recording.robot(t) @ pose_inverse(T_BC) for t in odometry.times.tolist()]
    with Writer(tmp_path / "bag", version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP) as bag:
        kinds = {"/twist": messages.TWIST, "/odom": messages.ODOMETRY}
        link = bag.add_connection(topic, kinds[topic], typestore=messages.store())
        for k, (t, twist) in enumerate(_rows(odometry)):
            stamp = t + 1.0
            data = messages.twist(stamp, twist, COVARIANCE)
            if topic == "/odom":
                data = messages.odometry(stamp, poses[k], np.eye(6))
            for _ in range(2):  # as some drivers repeat themselves
                bag.write(link, round(1e9 * stamp), data)
    mount = (0.2, 0.0, 0.9, 0.0, 5.0, 0.0)
    # What the poses' twist says of its noise is that there is nothing to say.
    sd = (0.02, 0.01) if topic == "/odom" else None
    read = read_odometry_topic(tmp_path / "bag", OdometryGiven(topic, mount, sd))
    np.testing.assert_allclose(read.times, odometry.times + 1.0, atol=1e-9)
    np.testing.assert_allclose(read.twists[1:], odometry.twists[1:], atol=1e-6)
    np.testing.assert_allclose(read.covariances[1], COVARIANCE, atol=1e-15)
    np.testing.assert_allclose(read.t_bc, T_BC)
    if topic == "/odom":
        with pytest.raises(DataError, match="odometry-sd"):
            read_odometry_topic(tmp_path / "bag", OdometryGiven(topic, mount))


def test_a_map_that_wheels_vouch_for_is_not_left_for_cfs(clip: Clip) -> None:
    """Cf contradicts the map's size: that is said, and wheels, which tell metres too, are believed."""
    odometry = wheels(clip)
    slam = Slam(clip.recording.camera, clip.recording.worn_camera, t_bc=T_BC)
    said = []
    for k, frame in enumerate(clip.frames):
        for t, twist in _rows(odometry)[1:]:
            if (clip.frames[k - 1].t if k else 0.0) < t - 0.02 <= frame.t:
                slam.add_odometry(t, twist, COVARIANCE)
        said.append(slam.step(frame.t, frame.image, stretched_later(frame.views, k)))
    assert said[-1].diagnostics["degraded_by"] == "size"
    assert not any(s.diagnostics["restarted"] for s in said)

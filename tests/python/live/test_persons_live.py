"""Several persons live: whose view is whose, each by a clock of its own, and nobody's faults cost another."""

from __future__ import annotations

import argparse
import socket
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helpers.busy import busy
from helpers.clip import Clip

pytest.importorskip("zenoh", reason="the extra live is not installed")
pytest.importorskip("cryptography", reason="the extra live is not installed")

from helpers.in_step import Behind, InStep
from helpers.waiting import LONGEST

from collabslam import Camera, Settings, SettingsError, Slam, open_recording
from collabslam.cli.live_robot import device_names
from collabslam.datasets import write_recording
from collabslam.datasets.wrapped import OnlyPersons, WrappedRecording
from collabslam.live import link, messages, names
from collabslam.live.cameras import RecordingPlayback
from collabslam.live.clock import Exchange
from collabslam.live.core import ClockReading, Event, LiveCore, LivePose, RobotFrame
from collabslam.live.downlink import status_of, view_picture, view_plans_of
from collabslam.live.gateway import Gateway
from collabslam.live.link import Address
from collabslam.live.plan import LivePlan
from collabslam.live.record import EventReader, EventWriter
from collabslam.live.replay import replay
from collabslam.live.results import LiveResults
from collabslam.live.robot import RobotNode, RobotOptions, worn_calibrations
from collabslam.live.slam import BOUNDS, LiveSlam
from collabslam.live.uplink import Uplink
from collabslam.live.views import BROKEN, NOBODY, REFUSED, LiveView
from collabslam.live.worn import WornDevice
from collabslam.runs.run_folder import RunFolder
from collabslam.types import Frame, Image, WornView, worn_cameras

PERSONS = ("anna", "ben")
OFFSETS = {"anna": 3.7, "ben": -12.0}
"""Seconds that their clocks show more than the robot's."""
FRAMES = 8


@pytest.fixture(scope="module")
def frames(clip: Clip) -> list[Frame]:
    return clip.frames[:FRAMES]


def engine(clip: Clip) -> Slam:
    return Slam(clip.recording.camera, dict.fromkeys(PERSONS, clip.recording.worn_camera))


def view(frame: Frame, session: str, shift: float = 0.0, *, encoded: bool = False) -> LiveView:
    worn = frame.views[0]
    if not encoded:
        return LiveView(session, frame.t + shift, worn.image, worn.t_cf, worn.covariance, worn.bias)
    image = cv2.imencode(".png", worn.image)[1].tobytes()
    return LiveView(session, frame.t + shift, image, worn.t_cf, worn.covariance)


def robot(frame: Frame) -> RobotFrame:
    return RobotFrame(frame.t, frame.image)


def sent(frames: list[Frame], *, encoded: bool = False) -> list[Event]:
    """What both send, each by the own clock, after what their clocks say; a view comes after its frame."""
    out: list[Event] = []
    for frame in frames:
        for name, offset in OFFSETS.items():
            asked = frame.t - 0.01 + offset
            exchange = Exchange(asked, frame.t - 0.01, frame.t - 0.01, asked)
            out.append(ClockReading(f"{name}/1", exchange))
        out.append(robot(frame))
        out += [view(frame, f"{name}/1", offset, encoded=encoded) for name, offset in OFFSETS.items()]
    return out


def fed(core: LiveCore, events: list[Event]) -> list[LivePose]:
    return [pose for event in events if (pose := core.handle(event)) is not None]


def bits(poses: list[LivePose]) -> list[bytes]:
    return [p.step.pose.tobytes() + p.step.covariance.tobytes() for p in poses]


@pytest.mark.slow
def test_live_is_offline_to_the_last_bit(clip: Clip, frames: list[Frame]) -> None:
    slam, late = engine(clip), list[WornView]()
    offline = []
    for frame in frames:
        step = slam.step(frame.t, frame.image, late)
        offline.append(step.pose.tobytes() + step.covariance.tobytes())
        assert frame.views
        late = [replace(frame.views[0], t=frame.t, who=name, body=True) for name in PERSONS]
    poses: list[LivePose] = []
    with LiveSlam(engine(clip), on_pose=poses.append, same_clock=True) as live:
        for frame in frames:
            for event in (robot(frame), *(view(frame, f"{name}/1") for name in PERSONS)):
                live.push(event)
            while live._events:  # the order of arrival is what is fixed, not the speed
                threading.Event().wait(0.001)
    assert bits(poses) == offline
    assert [p.sessions for p in poses] == [(), *[("anna/1", "ben/1")] * (FRAMES - 1)]
    assert set(poses[-1].step.worn) == set(PERSONS)
    assert live.sessions == {"anna": "anna/1", "ben": "ben/1"}


def test_each_has_a_clock(clip: Clip, frames: list[Frame]) -> None:
    core = LiveCore(engine(clip))
    poses = fed(core, sent(frames))
    assert core.dropped == {}
    for before, pose in zip(frames, poses[1:], strict=False):
        assert [worn.who for worn in pose.views] == list(PERSONS)
        assert [worn.t for worn in pose.views] == pytest.approx([before.t] * 2, abs=1e-6)


def test_another_name_is_another_person_and_the_same_name_a_new_session(
    clip: Clip, frames: list[Frame]
) -> None:
    core = LiveCore(engine(clip), same_clock=True)
    sessions = ["anna/1", "ben/1", "ben/2", "clara/1", "ben/1"]
    poses = fed(core, [robot(frames[0])])
    for k, session in enumerate(sessions, 1):
        poses += fed(core, [view(frames[k - 1], session), robot(frames[k])])
    assert [p.sessions for p in poses] == [(), ("anna/1",), ("ben/1",), ("ben/2",), (), ()]
    assert core.dropped == {NOBODY: 1, "other session": 1}
    assert core.senders.sessions == {"anna": "anna/1", "ben": "ben/2"}


def test_one_of_them_is_away(clip: Clip, frames: list[Frame]) -> None:
    core = LiveCore(engine(clip), same_clock=True)
    poses = fed(core, [robot(frames[0]), view(frames[0], "ben/1"), robot(frames[1])])
    assert poses[-1].links == {"anna": "mono", "ben": "collab"}
    assert poses[-1].link == "collab"


@pytest.mark.parametrize("fault", ["impossible", "broken"])
def test_a_broken_view_costs_its_sender_alone(clip: Clip, frames: list[Frame], fault: str) -> None:
    worn = frames[0].views[0]
    bad = {
        "impossible": LiveView("anna/1", frames[0].t, worn.image, worn.t_cf, -worn.covariance),
        "broken": LiveView("anna/1", frames[0].t, b"no image", worn.t_cf, worn.covariance),
    }[fault]
    core, other = (LiveCore(engine(clip), same_clock=True) for _ in range(2))
    good = view(frames[0], "ben/1")
    poses = fed(core, [robot(frames[0]), bad, good, robot(frames[1])])
    assert bits(poses) == bits(fed(other, [robot(frames[0]), good, robot(frames[1])]))
    assert poses[-1].sessions == ("ben/1",)
    assert core.dropped == {REFUSED if fault == "impossible" else BROKEN: 1}


def test_who_floods_pushes_nobody_else_out(clip: Clip, frames: list[Frame]) -> None:
    with busy(engine(clip), robot(frames[0])) as live:
        live.push(view(frames[0], "ben/1"))
        for k in range(2 * BOUNDS[LiveView]):
            live.push(view(frames[0], "anna/1", 1e-3 * k))
        waiting = [event.session for event in live._events if isinstance(event, LiveView)]
    assert waiting.count("ben/1") == 1
    assert waiting.count("anna/1") == BOUNDS[LiveView]


@pytest.mark.slow
def test_a_record_is_replayed_to_the_last_bit(clip: Clip, frames: list[Frame], tmp_path: Path) -> None:
    """And both leave the same files, of each person's camera, too."""
    settings = Settings.default()
    plan = LivePlan("collab-tight", "worn", dict(settings.values), [], [], persons=list(PERSONS))
    slam = Slam(clip.recording.camera, dict.fromkeys(PERSONS, clip.recording.worn_camera), mode=plan.mode)
    core = LiveCore(slam)
    (tmp_path / "live").mkdir()
    results = LiveResults(tmp_path / "live", settings, "metres", persons=PERSONS)
    given = [*sent(frames[:-1], encoded=True), view(frames[0], "clara/1", encoded=True), robot(frames[-1])]
    with EventWriter(tmp_path / "sent", plan, slam.camera, slam.worn_cameras) as record:
        for event in given:
            record.write(event, event.t if isinstance(event, RobotFrame) else 0.0)
    with EventWriter(tmp_path / "record", plan, slam.camera, slam.worn_cameras) as record:
        for event in EventReader(tmp_path / "sent").events():  # as messages have it
            record.write(event, event.t if isinstance(event, RobotFrame) else 0.0)
            pose = core.handle(event)
            if pose is not None:
                results.frame(pose)
    results.close()
    reader = EventReader(tmp_path / "record")
    assert list(reader.worn_cameras) == list(PERSONS)
    summary = replay(tmp_path / "record", tmp_path / "again")
    assert summary["dropped no person"] == 1
    for name in (
        "trajectory.tum",
        "trajectory.cov",
        *(f"worn-{p}.{k}" for p in PERSONS for k in ("tum", "cov")),
    ):
        live = (tmp_path / "live" / name).read_bytes()
        assert live.count(b"\n") > FRAMES - 2
        assert (tmp_path / "again" / name).read_bytes() == live, name
    rows = RunFolder(tmp_path / "again").frames()
    assert rows[-1]["session"] == "anna/1 ben/1"
    assert int(rows[-1]["worn_ben"]) > 8


def test_results_go_on_after_a_kill(clip: Clip, frames: list[Frame], tmp_path: Path) -> None:
    """A half line goes, and no line is written twice."""
    poses = fed(LiveCore(engine(clip)), sent(frames))
    settings = Settings.default()
    for folder, parts in (("whole", [poses]), ("killed", [poses[:5], poses[3:]])):
        (tmp_path / folder).mkdir()
        for k, part in enumerate(parts):
            results = LiveResults(tmp_path / folder, settings, "metres", persons=PERSONS, resumed=k > 0)
            for pose in part:
                results.frame(pose)
            results.close()
            if len(parts) > 1 and k == 0:
                with (tmp_path / folder / "worn-ben.tum").open("a") as file:
                    file.write("0.7 1.0 2")
    for name in PERSONS:
        for kind in ("tum", "cov"):
            whole = (tmp_path / "whole" / f"worn-{name}.{kind}").read_text()
            assert (tmp_path / "killed" / f"worn-{name}.{kind}").read_text() == whole


def test_the_picture_shows_each(clip: Clip, frames: list[Frame]) -> None:
    pose = fed(LiveCore(engine(clip), same_clock=True), sent_at_once(frames[:3]))[-1]
    assert [worn.who for worn in pose.views] == list(PERSONS)
    features = pose.step.features
    assert sum(len(features.pairs_of(name)) for name in PERSONS) == len(features.pairs) > 20
    one = cv2.imdecode(np.frombuffer(view_picture(replace(pose, views=pose.views[:1])), np.uint8), 1)
    both = cv2.imdecode(np.frombuffer(view_picture(pose), np.uint8), 1)
    robot_alone = cv2.imdecode(np.frombuffer(view_picture(replace(pose, views=())), np.uint8), 1)
    assert both.shape[1] - one.shape[1] == one.shape[1] - robot_alone.shape[1] > 100


def test_each_is_told_where_to_look(clip: Clip, frames: list[Frame]) -> None:
    settings = Settings.default().replace({"frontend.worn.next_best_view": True})
    lenses = dict.fromkeys(PERSONS, clip.recording.worn_camera)
    slam = Slam(clip.recording.camera, lenses, settings=settings)
    pose = fed(LiveCore(slam, same_clock=True), sent_at_once(frames[:4]))[-1]
    told = messages.status_from(
        status_of(pose, {}, {name: {} for name in PERSONS}, view_plans_of(pose, slam))
    )
    assert "next_view_gain" not in told["robot"]
    for name in PERSONS:
        plan = slam.next_best_view(name)
        assert plan is not None
        assert float(told[name]["next_view_gain"]) == pytest.approx(plan.gain, rel=1e-3)
        assert told[name]["message"] == "collab"


def sent_at_once(frames: list[Frame]) -> list[Event]:
    return [e for f in frames for e in (robot(f), *(view(f, f"{name}/1") for name in PERSONS))]


def test_each_device_has_its_own_calibration(clip: Clip, frames: list[Frame]) -> None:
    ours = clip.recording.worn_camera
    other = Camera("pinhole", ours.width, ours.height, (400.0, 400.0, 300.0, 200.0))
    events: list[Event] = []
    uplink = Uplink(events.append, lambda: 0.0)
    assert uplink.calibrations(PERSONS, 0.0) == {}
    uplink.use({"anna": ours, "ben": other})
    for name in PERSONS:
        uplink.take(names.key(name, names.CAMERA_INFO), messages.camera_info(0.0, name, ours))
        found = view(frames[0], f"{name}/1", encoded=True)
        pose = messages.pose(found.stamp, "cs", np.asarray(found.t_cf), np.asarray(found.covariance))
        uplink.take(names.key(name, names.T_CF), pose)
        image = messages.compressed_image(found.stamp, found.session, bytes(found.image))
        uplink.take(names.key(name, names.IMAGE), image)
    assert [e.session for e in events if isinstance(e, LiveView)] == ["anna/1"]
    assert uplink.counts() == {"other calibration": 1}
    assert set(uplink.calibrations(("ben", "clara"), 0.0)) == {"ben"}


def test_a_robot_waits_for_the_calibration_of_each(clip: Clip) -> None:
    lens, given = clip.recording.worn_camera, Camera("pinhole", 720, 480, (400.0, 400.0, 300.0, 200.0))
    uplink = Uplink(lambda event: None, lambda: 0.0)
    for name in ("anna", "clara"):
        uplink.take(names.key(name, names.CAMERA_INFO), messages.camera_info(0.0, name, lens))
    both, one = RecordingPlayback(Both(clip, 2)), RecordingPlayback(OnlyPersons(Both(clip, 2), ["ben"]))

    def found(camera: RecordingPlayback, **asked: Any) -> dict[str, Camera]:
        return worn_calibrations(RobotOptions(Path(), Settings.default(), **asked), camera, uplink)

    assert list(found(both)) == ["anna", "ben"]
    assert list(found(one, persons=("clara", "ben", "anna"))) == ["clara", "ben", "anna"]
    assert found(one, worn_cameras={"clara": given}) == {"clara": given}
    with pytest.raises(SettingsError, match="one person alone"):
        found(both, sensors=object())
    with pytest.raises(SettingsError, match=r"of 'clara', --persons of 'ben'; give both the same names"):
        found(both, persons=("ben",), worn_cameras={"clara": given})


@pytest.mark.parametrize("text", ["anna,Ben", "anna,robot", "anna,", "anna,anna"])
def test_devices_that_cannot_be_called_so_are_refused(text: str) -> None:
    assert device_names("anna,ben") == ("anna", "ben")
    with pytest.raises(argparse.ArgumentTypeError):
        device_names(text)


class Both(WrappedRecording):
    """The clip, in which both persons see the same."""

    def __init__(self, clip: Clip, count: int) -> None:
        super().__init__(clip.recording)
        self._frames = clip.frames[:count]
        self.times = np.array([f.t for f in self._frames])
        self.truth = None
        self.worn_cameras = dict.fromkeys(PERSONS, clip.recording.worn_camera)

    def __len__(self) -> int:
        return len(self._frames)

    def frame(self, i: int) -> Frame:
        frame = self._frames[i]
        return replace(frame, views=tuple(replace(v, who=name) for v in frame.views for name in PERSONS))

    def image(self, i: int) -> Image:
        return self._frames[i].image


def test_a_device_plays_the_person_of_its_name(clip: Clip) -> None:
    played = RecordingPlayback(Both(clip, 4))
    with pytest.raises(SettingsError, match=r"views of anna, ben.*'clara'"):
        played.play("clara")
    played.play("ben")
    assert list(worn_cameras(played.recording)) == ["ben"]
    assert played.recording.frame(0).views[0].who == "ben"


@pytest.mark.slow
def test_two_devices_and_a_robot_over_the_link(clip: Clip, tmp_path: Path) -> None:
    """What the robot recorded is replayed to the same files; both of them were of use."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        address = Address("127.0.0.1", s.getsockname()[1])
    folder = write_recording(Both(clip, len(clip.frames)), tmp_path / "walk")
    options = RobotOptions(tmp_path / "live", Settings.default(), record=tmp_path / "record")
    summaries = []
    with link.open_robot(address, None) as at_robot, link.open_device(address, None) as at_page:
        page = Gateway(at_page, "page", None)
        camera = InStep(open_recording(folder))
        node = RobotNode(at_robot, camera, options)
        camera.follow(node, *PERSONS)
        run = threading.Thread(target=lambda: summaries.append(node.run()))
        threads = [
            threading.Thread(target=play, args=(folder, name, address, run, camera)) for name in PERSONS
        ]
        for thread in (run, *threads):
            thread.start()
        for thread in (run, *threads):
            thread.join(LONGEST)
        with page.watching() as watch:
            facts, picture = watch.next()
    assert set(facts["persons"]) == set(PERSONS)
    assert {"anna: link", "ben: link"} <= set(facts["facts"])
    assert picture
    (summary,) = summaries
    replay(tmp_path / "record", tmp_path / "again")
    for name in ("trajectory.tum", *(f"worn-{person}.tum" for person in PERSONS)):
        live = (tmp_path / "live" / name).read_bytes()
        assert live.count(b"\n") > 10
        assert (tmp_path / "again" / name).read_bytes() == live
    assert summary["links"]["collab"] >= len(clip.frames) - 2


def played(folder: Path) -> RecordingPlayback:
    return RecordingPlayback(open_recording(folder))


def play(
    folder: Path, name: str, address: Address, robot: threading.Thread, played_by_robot: RecordingPlayback
) -> None:
    camera = played(folder)
    camera.clock = Behind(played_by_robot, 100.0)
    camera.play(name)
    lens = camera.recording.worn_camera
    with link.open_device(address, None) as session, WornDevice(session, name, lens, camera.clock) as device:
        InStep.send(device, camera, robot)

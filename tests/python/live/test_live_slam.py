"""Frames and views in any order from any thread: the same poses as offline, and a robot that never waits."""

from __future__ import annotations

import threading
import time
from collections import Counter
from dataclasses import replace

import cv2
import numpy as np
import pytest
from helpers.busy import busy
from helpers.clip import Clip

from collabslam import InputError, Slam
from collabslam.live.clock import Exchange
from collabslam.live.core import ClockReading, Event, LiveCore, LivePose, RobotFrame
from collabslam.live.downlink import VIEW_WIDTH, status_of, view_picture
from collabslam.live.messages import status_from
from collabslam.live.slam import BOUNDS, LiveSlam
from collabslam.live.views import BROKEN, NO_CLOCK, OTHER, REFUSED, LiveView
from collabslam.settings.table import Settings
from collabslam.slam.worn.late_views import FUTURE, REPEATED, SUPERSEDED
from collabslam.slam.worn.view_planning import DIAGNOSTICS
from collabslam.types import Frame

FRAMES = 14
OFFSET = 3.7


@pytest.fixture(scope="module")
def frames(clip: Clip) -> list[Frame]:
    return clip.frames[:FRAMES]


def view_of(frame: Frame, session: str = "anna/1", shift: float = 0.0) -> LiveView:
    (view,) = frame.views
    return LiveView(session, frame.t + shift, view.image, view.t_cf, view.covariance, view.bias)


def robot(frame: Frame) -> RobotFrame:
    return RobotFrame(frame.t, frame.image)


def events(frames: list[Frame], session: str = "anna/1") -> list[Event]:
    """Each view arrives a little after the frame of its instant."""
    out: list[Event] = []
    for frame in frames:
        out += [robot(frame), view_of(frame, session)]
    return out


def engine(clip: Clip) -> Slam:
    return Slam(clip.recording.camera, clip.recording.worn_camera)


def core_of(clip: Clip, *, same_clock: bool = True) -> LiveCore:
    return LiveCore(engine(clip), same_clock=same_clock)


def fed(core: LiveCore, events: list[Event]) -> list[LivePose]:
    return [pose for event in events if (pose := core.handle(event)) is not None]


def bits(poses: list[LivePose]) -> list[tuple[float, bytes, bytes]]:
    return [(p.step.t, p.step.pose.tobytes(), p.step.covariance.tobytes()) for p in poses]


@pytest.fixture(scope="module")
def offline(clip: Clip, frames: list[Frame]) -> list[tuple[float, bytes, bytes]]:
    slam = engine(clip)
    late = [[replace(view, t=frame.t) for view in frame.views] for frame in frames]
    steps = [slam.step(f.t, f.image, views) for f, views in zip(frames, [[], *late[:-1]], strict=True)]
    assert steps[-1].started
    return [(s.t, s.pose.tobytes(), s.covariance.tobytes()) for s in steps]


@pytest.mark.slow
def test_live_is_offline_to_the_last_bit(
    clip: Clip, frames: list[Frame], offline: list[tuple[float, bytes, bytes]]
) -> None:
    poses: list[LivePose] = []
    with LiveSlam(engine(clip), on_pose=poses.append, same_clock=True) as live:
        for event in events(frames):
            live.push(event)
            while live._events:  # the order of arrival is what is fixed, not the speed
                time.sleep(0.001)
    assert bits(poses) == offline
    assert live.dropped == {}
    assert [p.link for p in poses] == ["mono"] + ["collab"] * (FRAMES - 1)


def test_a_record_of_the_events_gives_the_same_poses(clip: Clip, frames: list[Frame]) -> None:
    """Whatever threads, drops and disorder did to them on the way."""
    record: list[Event] = []
    poses: list[LivePose] = []
    mixed = events(frames)
    generator = np.random.default_rng(1)
    views = [e for e in mixed if isinstance(e, LiveView)]
    others = [e for e in mixed if not isinstance(e, LiveView)]

    def send() -> None:
        for k in generator.permutation(len(views)):
            live.push(views[k])
            time.sleep(0.002)

    with LiveSlam(engine(clip), on_pose=poses.append, on_event=record.append, same_clock=True) as live:
        thread = threading.Thread(target=send)
        thread.start()
        for event in others:
            live.push(event)
            time.sleep(0.003)
        thread.join()
    assert bits(fed(core_of(clip), record)) == bits(poses)


def test_pushing_returns_at_once_whatever_the_filter_does(clip: Clip, frames: list[Frame]) -> None:
    with busy(engine(clip), robot(frames[0])) as live:
        for k in range(1, 100):
            live.push_robot(frames[0].t + 0.1 * k, frames[0].image)
            live.push(view_of(frames[0], shift=0.1 * k))
        # Views before the frames that are left give way with those that are lost.
        assert live.dropped == dict.fromkeys(("frames", "crowded"), 99 - BOUNDS[RobotFrame])


def test_the_newest_view_is_used_however_late(clip: Clip, frames: list[Frame]) -> None:
    core = core_of(clip)
    fed(core, events(frames[:4]))
    fed(core, [robot(f) for f in frames[4:8]])
    (pose,) = fed(core, [view_of(frames[4]), view_of(frames[5]), robot(frames[8])])
    assert [view.t for view in pose.views] == [frames[5].t]
    assert pose.step.diagnostics["overlap"] == 1
    assert core.dropped == Counter({SUPERSEDED: 1})  # that of frame 3 was used in frame 4


def test_each_view_that_is_dropped_is_counted_by_its_reason(clip: Clip, frames: list[Frame]) -> None:
    core = core_of(clip)
    poses = fed(core, [robot(f) for f in frames[:3]])
    wrong_size = LiveView("anna/1", frames[4].t, np.zeros((4, 4), np.uint8), np.eye(4), np.eye(6))
    no_image = LiveView("anna/1", frames[5].t, b"\xff\xd8 no picture", np.eye(4), np.eye(6))
    no_pose = LiveView("anna/1", frames[6].t, view_of(frames[6]).image, np.zeros((4, 4)), np.eye(6))
    strange = [
        view_of(frames[3]),
        view_of(frames[3]),
        view_of(frames[0]),
        view_of(frames[3], shift=-60.0),
        view_of(frames[3], shift=60.0),
        view_of(frames[3], "berta/1", shift=1e-4),
    ]
    poses += fed(core, [*strange, robot(frames[3])])
    for view, frame in zip((wrong_size, no_image, no_pose), frames[4:7], strict=True):
        poses += fed(core, [view, robot(frame)])
    counted = {REPEATED: 1, SUPERSEDED: 2, FUTURE: 1, OTHER: 1, BROKEN: 2, REFUSED: 1}
    assert core.dropped == Counter(counted)
    assert [bool(p.views) for p in poses] == [False, False, False, True, False, False, False]


def test_without_a_clock_views_are_not_used(clip: Clip, frames: list[Frame]) -> None:
    core = core_of(clip, same_clock=False)
    core.handle(robot(frames[0]))
    core.handle(view_of(frames[1], shift=OFFSET))
    assert core.dropped == Counter({NO_CLOCK: 1})


def test_a_clock_that_is_off_costs_certainty_of_t_cf(clip: Clip, frames: list[Frame]) -> None:
    core = core_of(clip, same_clock=False)
    poses: list[LivePose] = []
    for frame in frames:
        t = frame.t
        exchange = Exchange(t + OFFSET, t + 0.02, t + 0.02, t + OFFSET + 0.04)
        reading = ClockReading("anna/1", exchange)
        poses += fed(core, [reading, view_of(frame, shift=OFFSET), robot(frame)])
    used = [view for p in poses for view in p.views]
    assert len(used) == len(frames)
    before, after = frames[-1].views[0], used[-1]
    added = after.covariance - before.covariance
    speed = float(np.linalg.norm(core.slam.filter.velocity))
    assert np.sqrt(np.trace(added[:3, :3])) == pytest.approx(speed * 0.04 / np.sqrt(12.0), rel=0.3)
    assert np.linalg.eigvalsh(added)[0] > -1e-12


def test_a_sender_that_starts_anew_takes_its_place_at_once(clip: Clip, frames: list[Frame]) -> None:
    core = core_of(clip)
    for frame in frames[:4]:
        core.handle(view_of(frame, "anna/1"))
        core.handle(robot(frame))
    for frame in frames[4:6]:
        core.handle(view_of(frame, "anna/2"))
        core.handle(view_of(frame, "anna/1", shift=1e-3))
        poses = fed(core, [robot(frame)])
    assert [p.sessions for p in poses] == [("anna/2",)]
    assert core.dropped == Counter({OTHER: 2})


def test_another_sender_takes_over_when_the_first_is_silent(clip: Clip, frames: list[Frame]) -> None:
    core = core_of(clip)
    core.handle(view_of(frames[0], "anna/1"))
    core.handle(robot(frames[0]))
    sessions: list[str] = []
    for frame in frames[1:]:
        core.handle(view_of(frame, "berta/1"))
        sessions += ["".join(p.sessions) for p in fed(core, [robot(frame)])]
    silent = [before.t - frames[0].t > 1.0 for before in frames[:-1]]
    assert any(silent)
    assert sessions == ["berta/1" if s else "" for s in silent]


@pytest.mark.slow
def test_a_lost_link_is_mono_and_collab_again(clip: Clip, frames: list[Frame]) -> None:
    core = core_of(clip)
    links = []
    for k in range(30):
        frame = frames[min(k, FRAMES - 1)]
        t = 0.1 * k
        if not 5 <= k < 20:
            core.handle(view_of(frame, shift=t - frame.t))
        links += [p.link for p in fed(core, [RobotFrame(t, frame.image + np.uint8(k % 2))])]
    assert links == ["collab"] * 15 + ["mono"] * 5 + ["collab"] * 10


def test_encoded_views_of_any_size_are_scaled_to_the_calibration(clip: Clip, frames: list[Frame]) -> None:
    view = view_of(frames[0])
    small = cv2.resize(np.asarray(view.image), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    encoded = cv2.imencode(".jpg", small)[1].tobytes()
    core = core_of(clip)
    core.handle(LiveView(view.session, view.stamp, encoded, view.t_cf, view.covariance))
    (pose,) = fed(core, [robot(frames[0])])
    assert clip.recording.worn_camera is not None
    assert pose.views[0].image.shape == (clip.recording.worn_camera.height, clip.recording.worn_camera.width)
    assert pose.step.started


def test_what_a_callback_raises_ends_nothing(clip: Clip, frames: list[Frame]) -> None:
    def fails(pose: LivePose) -> None:
        raise RuntimeError("mine")

    with LiveSlam(engine(clip), on_pose=fails, same_clock=True) as live:
        live.push(robot(frames[0]))
        live.push(robot(frames[1]))
    assert isinstance(live.callback_error, RuntimeError)
    with pytest.raises(InputError, match="closed"):
        live.push(robot(frames[2]))


def test_a_frame_that_cannot_be_used_costs_only_itself(clip: Clip, frames: list[Frame]) -> None:
    poses: list[LivePose] = []
    with LiveSlam(engine(clip), on_pose=poses.append, same_clock=True) as live:
        live.push(robot(frames[0]))
        live.push_robot(frames[0].t, frames[0].image)
        live.push_robot(frames[1].t, np.zeros((3, 3), np.uint8))
        live.push(robot(frames[2]))
    assert [p.step.t for p in poses] == [frames[0].t, frames[2].t]
    assert live.dropped == {"frames": 2}
    with (
        pytest.raises(InputError, match="shape"),
        LiveSlam(engine(clip)) as live,
    ):
        live.push_worn(0.0, frames[0].image, np.eye(3), np.eye(6))


def test_the_picture_joins_what_both_see(clip: Clip, frames: list[Frame]) -> None:
    pose = next(p for p in reversed(fed(core_of(clip), events(frames))) if p.views)
    pairs = pose.step.features.pairs
    assert len(pairs) == pose.step.diagnostics["cf_matches"] > 5
    for camera, uv in ((clip.recording.camera, pairs[:, :2]), (clip.recording.worn_camera, pairs[:, 2:])):
        assert (uv >= 0).all()
        assert (uv <= (camera.width, camera.height)).all()
    alone = replace(pose.step, features=replace(pose.step.features, pairs=np.empty((0, 4)), pair_names=[]))
    with_lines, without = (
        cv2.imdecode(np.frombuffer(view_picture(p), np.uint8), cv2.IMREAD_COLOR).astype(int)
        for p in (pose, replace(pose, step=alone))
    )
    scale = VIEW_WIDTH / clip.recording.camera.width
    u, v, u_f, v_f = scale * pairs[0]
    middle = round(0.5 * (v + v_f)), round(0.5 * (u + u_f + VIEW_WIDTH))
    assert np.abs(with_lines - without)[middle].max() > 40


def test_the_status_says_where_to_look_where_the_run_asks_for_it(clip: Clip, frames: list[Frame]) -> None:
    camera, worn_camera = clip.recording.camera, clip.recording.worn_camera
    asked = Settings.default().replace({"frontend.worn.next_best_view": True})
    for settings in (None, asked):
        core = LiveCore(Slam(camera, worn_camera, settings=settings), same_clock=True)
        pose = fed(core, events(frames[:4]))[-1]
        robot_says = status_from(status_of(pose, {}, {}))["robot"]
        said = {name for name in robot_says if name.startswith("next_view_")}
        assert said == (set(DIAGNOSTICS) if settings else set())
    assert float(robot_says["next_view_right_deg"]) == pytest.approx(
        pose.step.diagnostics["next_view_right_deg"], rel=1e-3
    )

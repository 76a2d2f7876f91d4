"""A worn camera that nothing localises but a tag that both cameras see."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.clip import Clip
from helpers.posted import Posted

from collabslam import Settings, Tag
from collabslam.geometry import pose, pose_inverse, rotation_exp, se3_exp, se3_log
from collabslam.live.core import Event, LiveCore, LivePose, RobotFrame
from collabslam.live.plan import LivePlan
from collabslam.live.printed import make_slam
from collabslam.live.record import EventReader, EventWriter
from collabslam.live.replay import replay
from collabslam.live.tracked import OwnWorld
from collabslam.live.views import UNPOSED, LiveView, OwnPose
from collabslam.targets.printed import sightings
from collabslam.types import Frame, WornView

pytestmark = pytest.mark.slow

TAG = Tag("36h11", 3, 0.16)
AHEAD = pose(rotation_exp([0.1, 0.5, 0.05]), [0.15, 0.0, 2.3])
FRAMES = 10


@pytest.fixture(scope="module")
def posted(clip: Clip) -> Posted:
    return Posted(clip.recording, [(TAG, clip.recording.truth[0] @ AHEAD)], alone=False)


def events(posted: Posted) -> list[Event]:
    """Views without a pose, before their frames."""
    out: list[Event] = []
    for i in range(FRAMES):
        frame: Frame = posted.frame(i)
        if frame.views:
            png = cv2.imencode(".png", frame.views[0].image)[1].tobytes()
            out.append(LiveView("anna/1", frame.t, png))
        out.append(RobotFrame(frame.t, frame.image))
    return out


def core_of(posted: Posted, targets: list[Tag]) -> LiveCore:
    cameras = (posted.camera, {"": posted.worn_camera})
    slam = make_slam(*cameras, targets)
    return LiveCore(slam, same_clock=True, targets=targets)


def fed(core: LiveCore, events: list[Event]) -> list[LivePose]:
    return [pose for event in events if (pose := core.handle(event)) is not None]


def distance(clip: Clip, cs: int, cf: int, view: WornView) -> float:
    """Squared Mahalanobis distance of T_CF from the truth, Cs and Cf being those of two frames."""
    t_wf = clip.recording.truth[cf] @ clip.recording.true_t_cf(cf)
    error = se3_log(pose_inverse(view.t_cf) @ pose_inverse(clip.recording.truth[cs]) @ t_wf)
    return float(error @ np.linalg.solve(view.covariance, error))


def test_the_tag_tells_where_cf_is(clip: Clip, posted: Posted) -> None:
    poses = fed(core_of(posted, [TAG]), events(posted))
    used = [(i, view) for i, p in enumerate(poses) for view in p.views]
    assert len(used) >= 3
    assert all(view.t == poses[i - 1].step.t for i, view in used)  # of the frame that was there when it came
    assert np.mean([distance(clip, i - 1, i, view) for i, view in used]) < 12.0  # expected 6
    assert poses[-1].step.started
    assert poses[-1].step.metric


def test_a_phone_that_tracks_itself_saw_the_tag_once(clip: Clip, posted: Posted) -> None:
    """Afterwards it looks elsewhere: nothing but its own way tells where it is to the tag that Cs sees."""
    begins = pose(rotation_exp([0.3, -1.2, 0.2]), [5.0, -3.0, 2.0])  # of its world, anywhere
    noise = np.random.default_rng(3)
    sd = np.array([0.005] * 3 + [0.003] * 3)
    sent: list[Event] = []
    shown = 0
    for i in range(FRAMES):
        frame = posted.frame(i)
        for with_tag, without in zip(frame.views, clip.frames[i].views, strict=True):
            t_wf = clip.recording.truth[i] @ clip.recording.true_t_cf(i)
            own = OwnPose(begins @ t_wf @ se3_exp(sd * noise.standard_normal(6)), np.diag(sd**2))
            image = (with_tag if shown < 2 else without).image
            sent.append(LiveView("anna/1", frame.t, image, own=own))
            shown += 1
        sent.append(RobotFrame(frame.t, frame.image))
    core = core_of(posted, [TAG])
    poses = fed(core, sent)
    used = [(i, view) for i, p in enumerate(poses) for view in p.views]
    assert len(used) >= shown - 2
    times = [frame.t for frame in clip.frames]
    assert np.mean([distance(clip, times.index(view.t), i, view) for i, view in used]) < 12.0  # expected 6
    assert used[-1][1].bias is not None
    other = LiveView("anna/2", poses[-1].step.t + 0.1, sent[-2].image, own=OwnPose(np.eye(4), np.eye(6)))
    core.handle(other)
    frame = posted.frame(FRAMES - 1)
    core.handle(RobotFrame(poses[-1].step.t + 0.1, frame.image))
    assert (
        core.dropped[UNPOSED] == 2
    )  # when the first came there was no frame yet; another session's world is another one


def test_a_phone_that_finds_itself_elsewhere_begins_anew(clip: Clip, posted: Posted) -> None:
    world = OwnWorld()
    here, there = OwnPose(np.eye(4), 1e-6 * np.eye(6)), OwnPose(pose(np.eye(3), [3.0, 0.0, 0.0]), np.eye(6))
    frame = next(f for f in map(posted.frame, range(FRAMES)) if f.views)
    assert frame.views
    assert posted.worn_camera is not None
    world.move(1.0, here, sightings(frame.views[0].image, posted.worn_camera, [TAG]))
    ((first, time_correlated),) = world.sightings()
    assert time_correlated is None
    world.move(61.0, OwnPose(here.t_xf, here.covariance), [])
    ((later, time_correlated),) = world.sightings()
    assert time_correlated is not None
    np.testing.assert_allclose(later.t_tc, first.t_tc)
    grown = np.sqrt(np.diag(later.covariance - first.covariance)[3:])
    np.testing.assert_allclose(grown, np.deg2rad(0.5), rtol=0.1)  # after a minute
    world.move(61.1, there, [])
    assert world.sightings() == []


def test_without_the_tag_such_views_are_counted(posted: Posted) -> None:
    core = core_of(posted, [replace(TAG, number=5)])
    poses = fed(core, events(posted))
    assert [p.views for p in poses] == [()] * FRAMES
    assert core.dropped == {UNPOSED: sum(isinstance(e, LiveView) for e in events(posted))}


def test_a_record_keeps_the_tags(posted: Posted, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    plan = LivePlan("collab-tight", "worn", dict(Settings.default().values), [str(TAG)], [])
    with EventWriter(tmp_path / "record", plan, posted.camera, {"": posted.worn_camera}) as record:
        for k, event in enumerate(events(posted)):
            record.write(event, 0.01 * k)
    reader = EventReader(tmp_path / "record")
    assert reader.plan.targets == [TAG]
    views = [e for e in reader.events() if isinstance(e, LiveView)]
    assert all(v.t_cf is None for v in views)
    assert all(v.bias is None for v in views)
    assert replay(tmp_path / "record", tmp_path / "out")["frames"] == FRAMES


def test_a_record_keeps_what_of_t_cf_lasts(clip: Clip, tmp_path: Path) -> None:
    """To the last bit, also where it says nothing of some axes."""
    bias = np.outer(np.arange(6.0), np.arange(6.0)) / 7.0
    plan = LivePlan("collab-tight", "worn", dict(Settings.default().values), [], [])
    sent = [
        LiveView("anna/1", 1.0, b"\xff\xd8", np.eye(4), np.eye(6), bias),
        LiveView("anna/1", 2.0, b"\xff\xd8", np.eye(4), np.eye(6)),
        LiveView("anna/1", 3.0, b"\xff\xd8", own=OwnPose(AHEAD, np.diag(np.arange(1.0, 7.0)))),
    ]
    with EventWriter(
        tmp_path / "record", plan, clip.recording.camera, {"": clip.recording.worn_camera}
    ) as record:
        for view in sent:
            record.write(view, view.stamp)
    first, second, third = [e for e in EventReader(tmp_path / "record").events() if isinstance(e, LiveView)]
    assert first.bias is not None
    np.testing.assert_array_equal(first.bias, bias)
    assert second.bias is None
    assert second.own is None
    assert third.own is not None
    assert third.t_cf is None
    np.testing.assert_allclose(third.own.t_xf, AHEAD, atol=1e-12)
    np.testing.assert_allclose(third.own.covariance, np.diag(np.arange(1.0, 7.0)), atol=1e-9)

"""A worn camera that nothing localises but a tag that both cameras see."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Clip
from posted import Posted

from collabslam import Settings, Tag
from collabslam.geometry import pose, pose_inverse, rotation_exp, se3_log
from collabslam.live.core import Event, LiveCore, LivePose, RobotFrame
from collabslam.live.printed import make_slam, printed_poses
from collabslam.live.record import EventReader, EventWriter, LivePlan
from collabslam.live.replay import replay
from collabslam.live.views import UNPOSED, LiveView
from collabslam.types import Frame

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
        if frame.worn is not None:
            png = cv2.imencode(".png", frame.worn.image)[1].tobytes()
            out.append(LiveView("anna/1", frame.t, png))
        out.append(RobotFrame(frame.t, frame.image))
    return out


def core_of(posted: Posted, targets: list[Tag]) -> LiveCore:
    cameras = (posted.camera, posted.worn_camera)
    slam = make_slam(*cameras, targets)
    return LiveCore(slam, same_clock=True, printed=printed_poses(*cameras, targets))


def fed(core: LiveCore, events: list[Event]) -> list[LivePose]:
    return [pose for event in events if (pose := core.handle(event)) is not None]


def test_the_tag_tells_where_cf_is(clip: Clip, posted: Posted) -> None:
    poses = fed(core_of(posted, [TAG]), events(posted))
    used = [(i, p) for i, p in enumerate(poses) if p.worn is not None]
    assert len(used) >= 3
    distance = []
    for i, p in used:
        assert p.worn is not None
        error = se3_log(pose_inverse(p.worn.t_cf) @ clip.recording.true_t_cf(i))
        distance.append(error @ np.linalg.solve(p.worn.covariance, error))
    assert np.mean(distance) < 12.0  # 6 is honest
    assert poses[-1].step.started
    assert poses[-1].step.metric


def test_without_the_tag_such_views_are_counted(posted: Posted) -> None:
    core = core_of(posted, [replace(TAG, number=5)])
    poses = fed(core, events(posted))
    assert [p.worn for p in poses] == [None] * FRAMES
    assert core.views.dropped == {UNPOSED: sum(isinstance(e, LiveView) for e in events(posted))}


def test_a_record_keeps_the_tags(posted: Posted, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    plan = LivePlan("collab-tight", "worn", dict(Settings.default().values), [str(TAG)], [])
    with EventWriter(tmp_path / "record", plan, posted.camera, posted.worn_camera) as record:
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
    ]
    with EventWriter(tmp_path / "record", plan, clip.recording.camera, clip.recording.worn_camera) as record:
        for view in sent:
            record.write(view, view.stamp)
    first, second = [e for e in EventReader(tmp_path / "record").events() if isinstance(e, LiveView)]
    assert first.bias is not None
    np.testing.assert_array_equal(first.bias, bias)
    assert second.bias is None

"""What the setting ``worn.late`` promises: a view that is 2.5 s late is used, wherever it comes from."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import collabslam
from collabslam import RecordingWriter, Settings, Slam
from collabslam.datasets.wrapped import FirstFrames
from collabslam.live.core import LiveCore, LivePose, RobotFrame
from collabslam.live.printed import KEPT, PrintedPoses
from collabslam.live.views import LiveView
from collabslam.results import StepResult
from collabslam.simulation import corridor_recording
from collabslam.targets.kinds import Tag
from collabslam.types import Frame, WornView
from collabslam_lab.hardware.free_running import FreeRunning, WornClock

FRAMES = 32
TAKEN = 0.53
"""Seconds; the last frame is of 3.1 s."""
SLOW_LINK = Settings.default().replace({"filter.worn.late": 3.0})


@cache
def corridor() -> Any:
    return corridor_recording(length_m=6.0, glances=((0.0, np.inf),))


@cache
def frame(i: int) -> Frame:
    return corridor().frame(i)


@cache
def worn(t: float) -> WornView:
    return corridor().worn_at(t, round(1000 * t))


def handed_in(settings: Settings) -> tuple[StepResult, dict[str, int]]:
    """By `Slam.add_worn`."""
    slam = Slam(corridor().camera, corridor().worn_camera, settings=settings)
    for i in range(FRAMES):
        if i == 2:
            slam.add_worn(worn(0.13))  # late, too: from here on poses are kept
        if i == FRAMES - 1:
            slam.add_worn(worn(TAKEN))
        step = slam.step(frame(i).t, frame(i).image, frame(i).views if i < 2 else ())
    return step, slam.worn_dropped


def live(settings: Settings) -> tuple[StepResult, dict[str, int]]:
    """Over a link."""
    core = LiveCore(Slam(corridor().camera, corridor().worn_camera, settings=settings), same_clock=True)

    def sent(view: WornView, t: float) -> LiveView:
        return LiveView("anna/1", t, view.image, view.t_cf, view.covariance)

    poses: list[LivePose] = []
    for i in range(FRAMES):
        views = [sent(frame(i).views[0], frame(i).t)] if i < 2 else []
        views += [sent(worn(0.13), 0.13)] if i == 2 else []
        views += [sent(worn(TAKEN), TAKEN)] if i == FRAMES - 1 else []
        for event in (*views, RobotFrame(frame(i).t, frame(i).image)):
            pose = core.handle(event)
            poses += [] if pose is None else [pose]
    assert len(poses) == FRAMES
    return poses[-1].step, dict(core.dropped)


@pytest.mark.parametrize("fed", [handed_in, live])
def test_a_view_that_comes_late_is_used(
    fed: Callable[[Settings], tuple[StepResult, dict[str, int]]],
) -> None:
    step, dropped = fed(SLOW_LINK)
    assert step.diagnostics["cf_pixel_rows"] > 5
    assert step.worn[""].measured
    assert step.worn[""].t == TAKEN
    before = dropped.get("stale", 0)
    step, dropped = fed(Settings.default())
    assert step.diagnostics["cf_pixel_rows"] == 0
    assert dropped["stale"] == before + 1


def test_a_recording_whose_views_come_late_is_of_use() -> None:
    recording = FirstFrames(FreeRunning(corridor(), corridor().worn_at, WornClock(5.0, 0.0, 2.5)), FRAMES)
    summary = collabslam.run(recording, settings=SLOW_LINK).summary
    assert summary["frames_ok"] > 3
    assert summary["worn"][0]["measured"] >= 3
    assert collabslam.run(recording).summary["worn"][0]["measured"] == 0


def test_a_recording_keeps_the_views_of_a_gap_between_two_frames(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "walk", corridor().camera, corridor().worn_camera) as writer:
        writer.add(frame(0).t, frame(0).image, frame(0).views)
        writer.add(frame(1).t, frame(1).image)
        writer.add(frame(FRAMES - 1).t, frame(FRAMES - 1).image, [worn(TAKEN)])
    read = collabslam.open_recording(tmp_path / "walk")
    assert [[view.t for view in read.frame(i).views] for i in range(3)] == [[None], [], [TAKEN]]


@pytest.mark.parametrize("rate", [5.0, 10.0, 30.0])
@pytest.mark.parametrize("late", [1.0, 3.0, 10.0])
def test_frames_are_kept_for_as_long_and_no_more_than_so_many(late: float, rate: float) -> None:
    image = np.zeros((2, 2), np.uint8)
    printed = PrintedPoses(corridor().camera, {"": corridor().worn_camera}, [Tag("36h11", 3, 0.16)], late)
    for k in range(int(12.0 * rate)):
        printed.frame(k / rate, image)
    times = [kept.t for kept in printed._frames]
    assert len(times) <= KEPT + 2
    assert times[-1] == (int(12.0 * rate) - 1) / rate
    assert times[-1] - times[0] >= late - 1.0 / rate
    assert np.diff(times[:-1]).max() <= late / KEPT + 1.0 / rate
